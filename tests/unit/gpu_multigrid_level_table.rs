//! Unit tests of `src/gpu/multigrid/level_table.rs`.

use super::*;
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::Hierarchy;
use crate::{Mesh, Options};

/// The table, read as `stages/levels.wgsl` reads it, contains the levels, whether their colors are whole or split into
/// parts.
#[test]
fn a_table_says_what_the_levels_are() {
    let options = Options { pinned: (0..70).collect(), ..Options::default() };
    let cloth = Cloth::new(&Mesh::grid(70, 50, 1.0, 1.0), &options).unwrap();
    let all = &Hierarchy::new(&cloth).levels;
    assert!(all.len() > 2);
    for (finest, below, most) in [(0, None, 512), (0, Some(0), 32), (1, Some(5), 512)] {
        let mut table = LevelTable::with_width(all, finest, below, most);
        let numbers = |level: &Level| level.links.iter().enumerate().map(|(k, _)| k as f32 + 0.5).collect::<Vec<_>>();
        let edge = |k: f32| Edge { inverse_rest: k, inverse_weight: -k, ..Edge::default() };
        let edges: Vec<Vec<Edge>> = all.iter().map(|level| numbers(level).into_iter().map(edge).collect()).collect();
        table.set_edges(&edges);
        let levels = &all[finest..];
        let word = |k: usize| table.table[k] as usize;
        let (sweeps, labels, width) = (2 * (levels.len() + 1), 3 * levels.len() + 2, table.width);
        let lists = labels + table.aggregates;
        let members = lists + 2 * table.of_finest * table.averaged;
        assert_eq!(members + 2 * table.members * (table.aggregates - table.averaged), table.edges);
        assert_eq!(table.of_finest > 0, below.is_some());
        assert!(width <= most && (most > 32 || table.runs.len() > levels.iter().map(|level| level.colors.len() + 4).sum()));
        for (index, level) in levels.iter().enumerate() {
            let place = word(index);
            assert_eq!(word(index + 1) - place, level.inverse_mass.len());
            assert_eq!(word(sweeps + index), level.sweeps as usize);
            for (k, &item) in level.members.items.iter().enumerate().filter(|_| index > 0 || below.is_some()) {
                let aggregate = place + level.label[item as usize] as usize;
                let (list, room, base) = match index {
                    0 => (lists, table.of_finest, below.unwrap()),
                    _ => (members + 2 * table.members * (place - table.averaged), table.members, word(index - 1)),
                };
                let count = level.inverse_mass.len();
                let pairs = (0..room).map(|m| list + 2 * count * m + aggregate - place).map(|at| [word(at), word(at + count)]);
                assert!(index == 0 || word(labels + base + item as usize) == aggregate);
                let of_item = pairs.filter(|[member, _]| *member == base + item as usize);
                assert!(of_item.map(|[_, share]| f32::from_bits(share as u32)).sum::<f32>() == level.share[k]);
            }
            let first = word(levels.len() + 1 + index);
            let last = if index > 0 { word(levels.len() + index) } else { word(2 * levels.len() + 1) };
            assert!(first % 4 == 0 && first <= last && last <= table.colors);
            let mut met = Vec::new();
            for color in first..last {
                let block = &table.table[table.edges + 3 * width * color..][..3 * width];
                for (k, &ends) in block[..width].iter().enumerate().filter(|(_, ends)| **ends != NONE) {
                    let number = f32::from_bits(block[width + k]);
                    assert_eq!(f32::from_bits(block[2 * width + k]), -number);
                    let link = &level.links[number as usize];
                    assert_eq!([ends & 0xffff, ends >> 16], link.ends.map(|end| end + place as u32));
                    met.push(number as usize);
                }
            }
            assert_eq!(met, (0..level.links.len()).collect::<Vec<_>>(), "each edge once, color after color");
        }
    }
}
