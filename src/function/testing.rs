//! Helpers for the tests of the functions, which run over every family of [`crate::map::FAMILIES`].

use crate::device::FileBoard;
use crate::map::Family;

/// A board's memory of zeros, and another way to it: the host's and PMAC's.
pub fn two_sides(family: &Family) -> [FileBoard; 2] {
    let file = tempfile::tempfile().unwrap();
    file.set_len(family.length.into()).unwrap();
    [(); 2].map(|()| FileBoard::from_file(&file, family.length as usize).unwrap())
}

/// A board's memory of zeros.
pub fn memory(family: &Family) -> FileBoard {
    let [memory, _] = two_sides(family);
    memory
}
