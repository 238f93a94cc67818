//! Sets of motors and of coordinate systems: two kinds of mask, two types.
//!
//! A family has at most 32 motors and 16 coordinate systems. Both count from 1; in the masks of the board, of the segment
//! and of the socket's messages, bit 0 is number 1.

use std::fmt;

macro_rules! set_of_numbers {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
        pub struct $name(u32);

        impl $name {
            /// No number.
            pub const NONE: Self = Self(0);
            /// All numbers up to the largest that any family has.
            pub const ALL: Self = Self(u32::MAX);

            /// The set of one number, from 1. A number beyond 32 gives the empty set, 0 too.
            #[must_use]
            pub const fn of(number: usize) -> Self {
                if number == 0 || number > 32 { Self::NONE } else { Self(1 << (number - 1)) }
            }

            /// Numbers 1 to `count`.
            #[must_use]
            pub const fn first(count: usize) -> Self {
                if count < 32 { Self((1 << count) - 1) } else { Self::ALL }
            }

            /// Bit 0 is number 1.
            #[must_use]
            pub const fn from_bits(bits: u32) -> Self {
                Self(bits)
            }

            /// Bit 0 is number 1.
            #[must_use]
            pub const fn bits(self) -> u32 {
                self.0
            }

            /// Whether no number is in it.
            #[must_use]
            pub const fn is_empty(self) -> bool {
                self.0 == 0
            }

            /// How many numbers are in it.
            #[must_use]
            pub const fn len(self) -> usize {
                self.0.count_ones() as usize
            }

            /// Whether `number`, from 1, is in it.
            #[must_use]
            pub const fn contains(self, number: usize) -> bool {
                self.meets(Self::of(number))
            }

            /// Whether the two sets have a number in common.
            #[must_use]
            pub const fn meets(self, other: Self) -> bool {
                self.0 & other.0 != 0
            }

            /// Whether every number of `other` is in this set.
            #[must_use]
            pub const fn has_all(self, other: Self) -> bool {
                other.0 & !self.0 == 0
            }

            /// The numbers of both.
            #[must_use]
            pub const fn and(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }

            /// The numbers that both have.
            #[must_use]
            pub const fn among(self, other: Self) -> Self {
                Self(self.0 & other.0)
            }

            /// The numbers of this set that are not in `other`.
            #[must_use]
            pub const fn without(self, other: Self) -> Self {
                Self(self.0 & !other.0)
            }

            /// Puts the numbers of `other` in.
            pub const fn add(&mut self, other: Self) {
                self.0 |= other.0;
            }

            /// Takes the numbers of `other` out.
            pub const fn remove(&mut self, other: Self) {
                self.0 &= !other.0;
            }

            /// The numbers, from 1, ascending.
            pub fn numbers(self) -> impl Iterator<Item = usize> {
                (1..=32).filter(move |number| self.contains(*number))
            }
        }

        impl FromIterator<usize> for $name {
            fn from_iter<I: IntoIterator<Item = usize>>(numbers: I) -> Self {
                numbers.into_iter().fold(Self::NONE, |set, number| set.and(Self::of(number)))
            }
        }

        /// The numbers with commas: `1, 2, 5`.
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let mut separator = "";
                self.numbers().try_for_each(|number| {
                    write!(f, "{}{number}", std::mem::replace(&mut separator, ", "))
                })
            }
        }
    };
}

set_of_numbers! {
    /// A set of motors, numbered from 1.
    Motors
}
set_of_numbers! {
    /// A set of coordinate systems, numbered from 1.
    Systems
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_holds_the_numbers_that_it_was_given() {
        let motors: Motors = [1, 5, 32].into_iter().collect();
        assert_eq!(motors.bits(), 0x8000_0011);
        assert_eq!(motors.numbers().collect::<Vec<_>>(), [1, 5, 32]);
        assert_eq!(motors.to_string(), "1, 5, 32");
        assert_eq!(motors.without(Motors::of(5)).len(), 2);
        assert!(motors.has_all(Motors::of(5)) && !motors.contains(2) && motors.meets(Motors::first(1)));
        assert!(!Motors::of(5).has_all(motors));
    }

    #[test]
    fn a_number_that_no_board_has_is_in_no_set() {
        assert!([0, 33, usize::MAX].into_iter().collect::<Systems>().is_empty());
        assert_eq!((Systems::first(0), Systems::first(32)), (Systems::NONE, Systems::ALL));
        assert!(!Systems::ALL.contains(33) && !Systems::ALL.contains(0));
    }
}
