//! Lists of unequal length in a layout for which neighboring lanes read neighboring words: the lists of a slice of vertices are
//! interleaved item by item and padded to the longest of them (sliced ELLPACK; Monakov, Lokhmotov and Avetisyan 2010).

/// The number of vertices in a slice: `SLICE` of `stages/bend_in_workgroup.wgsl`.
pub(crate) const SLICE: usize = 32;

/// Appends the lists of `count` vertices to a table: first the word at which the items of each slice start, and the end of the
/// last; then the items. An item has `W` words; the first words of one item of each vertex of a slice come first, then the
/// second words, and so on. `filler` pads the list of a vertex.
pub(crate) fn push_slices<const W: usize, I: ExactSizeIterator<Item = [u32; W]>>(
    table: &mut Vec<u32>,
    count: usize,
    list: impl Fn(usize) -> I,
    filler: impl Fn(usize) -> [u32; W],
) {
    let starts = table.len();
    table.resize(starts + count.div_ceil(SLICE) + 1, 0);
    for slice in 0..count.div_ceil(SLICE) {
        let vertices = slice * SLICE..((slice + 1) * SLICE).min(count);
        let longest = vertices.clone().map(|vertex| list(vertex).len()).max().unwrap_or(0);
        let start = table.len();
        table[starts + slice] = start as u32;
        table.resize(start + W * SLICE * longest, 0);
        for (lane, vertex) in vertices.enumerate() {
            let filled = list(vertex).chain(std::iter::repeat(filler(vertex)));
            for (item, words) in filled.take(longest).enumerate() {
                (0..W).for_each(|word| table[start + (item * W + word) * SLICE + lane] = words[word]);
            }
        }
    }
    let end = table.len() as u32;
    table[starts + count.div_ceil(SLICE)] = end;
}
