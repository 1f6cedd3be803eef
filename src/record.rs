//! Encoding of the state as bytes. One description of a struct serves both writing and reading.
//!
//! Numbers are little-endian and follow each other without gaps; lists and options begin with their length. A struct
//! lists its fields with [`recorded`], which fails to compile if a field is missing from the list, so that nobody can
//! add state and forget to record it.

use std::collections::VecDeque;

use glam::{Quat, Vec3, Vec4};

/// Bytes being written (`Out`) or still to be read (`In`).
pub(crate) enum Tape<'a> {
    Out(Vec<u8>),
    In(&'a [u8]),
}

/// The bytes cannot be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Unreadable;

impl Tape<'_> {
    fn pass<const N: usize>(&mut self, bytes: [u8; N]) -> Result<[u8; N], Unreadable> {
        match self {
            Tape::Out(tape) => {
                tape.extend_from_slice(&bytes);
                Ok(bytes)
            }
            Tape::In(tape) => {
                let (first, rest) = tape.split_first_chunk().ok_or(Unreadable)?;
                *tape = rest;
                Ok(*first)
            }
        }
    }
}

/// A value that can be written to a tape, or overwritten with what is read from one.
pub(crate) trait Recorded {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable>;

    /// Encodes the value.
    fn to_tape(&mut self) -> Vec<u8> {
        let mut tape = Tape::Out(Vec::new());
        let written = self.record(&mut tape);
        match tape {
            Tape::Out(bytes) if written.is_ok() => bytes,
            _ => Vec::new(),
        }
    }

    /// Decodes a value from all of the bytes.
    fn from_tape(bytes: &[u8]) -> Result<Self, Unreadable>
    where
        Self: Sized + Default,
    {
        let (mut made, mut tape) = (Self::default(), Tape::In(bytes));
        made.record(&mut tape)?;
        match tape {
            Tape::In([]) => Ok(made),
            _ => Err(Unreadable),
        }
    }
}

/// Implements [`Recorded`] for a struct. Every field must be listed: state first, then, after `but`, fields that are
/// computed from elsewhere.
macro_rules! recorded {
    ($name:ty { $($field:ident),* $(,)? } $(but { $($other:ident),* $(,)? })?) => {
        impl $crate::record::Recorded for $name {
            fn record(&mut self, tape: &mut $crate::record::Tape<'_>) -> Result<(), $crate::record::Unreadable> {
                let Self { $($field,)* $($($other: _,)*)? } = self;
                $($crate::record::Recorded::record($field, tape)?;)*
                Ok(())
            }
        }
    };
}
pub(crate) use recorded;

macro_rules! recorded_numbers {
    ($($number:ty, $valid:expr;)*) => {$(
        impl Recorded for $number {
            fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
                let read = <$number>::from_le_bytes(tape.pass(self.to_le_bytes())?);
                let is_valid: fn($number) -> bool = $valid;
                if matches!(tape, Tape::In(_)) {
                    *self = Some(read).filter(|&read| is_valid(read)).ok_or(Unreadable)?;
                }
                Ok(())
            }
        }
    )*};
}
recorded_numbers! { u8, |_| true; u32, |_| true; u64, |_| true; f32, f32::is_finite; f64, f64::is_finite; }

impl Recorded for usize {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let mut number = *self as u64;
        number.record(tape)?;
        *self = usize::try_from(number).map_err(|_| Unreadable)?;
        Ok(())
    }
}

impl Recorded for bool {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let mut number = u8::from(*self);
        number.record(tape)?;
        *self = number == 1;
        if number < 2 { Ok(()) } else { Err(Unreadable) }
    }
}

impl<T: Recorded, const N: usize> Recorded for [T; N] {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        self.iter_mut().try_for_each(|value| value.record(tape))
    }
}

impl<T: Recorded + Default> Recorded for Option<T> {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let mut is_some = self.is_some();
        is_some.record(tape)?;
        if is_some { self.get_or_insert_default().record(tape) } else { Ok(()) }
    }
}

impl<T: Recorded + Default> Recorded for Vec<T> {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let mut count = self.len();
        count.record(tape)?;
        if let Tape::Out(_) = tape {
            return self.iter_mut().try_for_each(|value| value.record(tape));
        }
        // The list grows value by value, so that an altered count cannot allocate much memory.
        self.clear();
        for _ in 0..count {
            let mut value = T::default();
            value.record(tape)?;
            self.push(value);
        }
        Ok(())
    }
}

impl<T: Recorded + Default> Recorded for VecDeque<T> {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let mut list: Vec<T> = std::mem::take(self).into();
        let recorded = list.record(tape);
        *self = list.into();
        recorded
    }
}

macro_rules! recorded_vectors {
    ($($vector:ty),*) => {$(
        impl Recorded for $vector {
            fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
                let mut numbers = self.to_array();
                numbers.record(tape)?;
                *self = <$vector>::from_array(numbers);
                Ok(())
            }
        }
    )*};
}
recorded_vectors!(Vec3, Vec4, Quat);

/// 64-bit FNV-1a (Fowler, Noll and Vo; RFC 9923). Inputs of equal length that differ in a single byte always have
/// different hashes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hash(pub u64);

impl Hash {
    pub(crate) const NOTHING: Hash = Hash(0xcbf2_9ce4_8422_2325);

    /// The hash with more bytes appended.
    pub(crate) fn with(self, bytes: &[u8]) -> Hash {
        Hash(bytes.iter().fold(self.0, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)))
    }
}
