//! Which backend is chosen.

use super::*;
use crate::model::mesh::Mesh;
use crate::options::Contact;

/// A GPU pays off for smaller cloth if there is contact of triangles, and never with a budget.
#[test]
fn a_gpu_pays_for_large_cloth() {
    let pays = |side: u32, contact: Option<Contact>, quality: Quality| {
        let options = Options { quality, contact, ..Options::default() };
        gpu_pays(&Cloth::new(&Mesh::grid(side, side, 1.0, 1.0), &options).unwrap(), &options)
    };
    let (contact, quality) = (Some(Contact::default()), Quality::Substeps(2));
    assert_eq!([127, 128].map(|side| pays(side, None, quality)), [false, true]);
    assert_eq!([63, 64].map(|side| pays(side, contact, quality)), [false, true]);
    assert_eq!([None, contact].map(|contact| pays(128, contact, Quality::Budget(4.0))), [false; 2]);
}
