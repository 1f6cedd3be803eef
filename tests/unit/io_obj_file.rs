//! Unit tests of `src/io/obj/file.rs`.

use super::*;

#[test]
fn reading_ends_at_the_limit() {
    for (length, expected) in [(99, Some(99)), (100, Some(100)), (101, None), (u64::MAX, None)] {
        let read = up_to(100, io::repeat(b'v').take(length)).unwrap();
        assert_eq!(read.map(|bytes| bytes.len()), expected, "{length}");
    }
}
