//! Lists of unequal length, laid out so that lanes beside each other read beside each other: the lists of a slice of vertices are stored
//! item by item, each filled up to the longest of them (sliced ELLPACK: Monakov, Lokhmotov and Avetisyan 2010).

/// Vertices whose items lie side by side: `SLICE` of `stages/bend_in_workgroup.wgsl`.
pub(crate) const SLICE: usize = 32;

/// Adds the lists of `count` vertices to a table: for each slice where in the table its items start, and the end of the last; then the items.
/// Each is `W` words, all first words of a slice's items in a run, then all second ones. What fills up a vertex's list is `filler`.
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
