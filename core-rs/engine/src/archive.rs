//! The changing state of a running simulation as bytes: one list of fields serves both to write and to read them.
//!
//! An archive holds no type names, and no lengths that the plan fixes: it can only be read into a simulation of an
//! equal plan. Bytes that do not fit are refused; numbers are restored to the last bit.

/// The bytes are not the state of such a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("these bytes are not the state of this simulation")]
pub struct Damaged;

/// What [`State::archive`] does with a state: write, read, count, or compare it.
#[derive(Debug)]
pub(crate) enum Archive<'a> {
    Write(&'a mut Vec<u8>),
    Read(&'a [u8]),
    /// Adds up the number of bytes that would be written.
    Count(&'a mut usize),
    /// Writes as long as there is capacity, and fails beyond it: nothing is allocated.
    Note(&'a mut Vec<u8>),
    /// Fails unless the state equals these bytes.
    Same(&'a [u8]),
}

/// A value with a state that can be archived.
pub(crate) trait State {
    /// Write the state, or replace it by the next one in the archive.
    ///
    /// # Errors
    /// [`Damaged`] if the archive does not hold such a state; the value is then unusable.
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged>;
}

impl Archive<'_> {
    fn bytes<const N: usize>(&mut self, number: [u8; N]) -> Result<[u8; N], Damaged> {
        match self {
            Self::Write(to) => {
                to.extend_from_slice(&number);
                Ok(number)
            }
            Self::Read(from) => {
                let (first, rest) = from.split_first_chunk().ok_or(Damaged)?;
                *from = rest;
                Ok(*first)
            }
            Self::Count(size) => {
                **size += N;
                Ok(number)
            }
            Self::Note(to) => {
                if to.capacity() - to.len() < N {
                    return Err(Damaged);
                }
                to.extend_from_slice(&number);
                Ok(number)
            }
            Self::Same(known) => {
                let (first, rest) = known.split_first_chunk().ok_or(Damaged)?;
                *known = rest;
                if *first == number {
                    Ok(number)
                } else {
                    Err(Damaged)
                }
            }
        }
    }

    /// A list whose length changes during a simulation.
    pub(crate) fn list<T: State + Default>(&mut self, list: &mut Vec<T>) -> Result<(), Damaged> {
        let mut len = list.len();
        len.archive(self)?;
        if let Self::Read(from) = self {
            // Each entry takes at least a byte: so no archive makes this allocate for more entries than it has bytes.
            if len > from.len() {
                return Err(Damaged);
            }
            list.clear();
            list.resize_with(len, T::default);
        }
        list.iter_mut().try_for_each(|own| own.archive(self))
    }

    /// An option that comes and goes during a simulation.
    pub(crate) fn maybe<T: State + Default>(
        &mut self,
        state: &mut Option<T>,
    ) -> Result<(), Damaged> {
        let mut is_there = state.is_some();
        is_there.archive(self)?;
        if is_there {
            state.get_or_insert_default().archive(self)
        } else {
            *state = None;
            Ok(())
        }
    }

    /// An option that is either always or never there, as the plan says.
    pub(crate) fn fixed<T: State>(&mut self, state: &mut Option<T>) -> Result<(), Damaged> {
        let mut is_there = state.is_some();
        is_there.archive(self)?;
        match state {
            Some(state) if is_there => state.archive(self),
            None if !is_there => Ok(()),
            _ => Err(Damaged),
        }
    }

    /// Whether the archive was read, or compared, to its end.
    pub(crate) fn is_empty(&self) -> bool {
        matches!(self, Self::Read([]) | Self::Same([]))
    }
}

/// Implements `State` for an option: one that comes and goes (`maybe`), or is always or never there (`fixed`).
macro_rules! option {
    ($kind:ty, $which:ident) => {
        impl $crate::archive::State for Option<$kind> {
            fn archive(
                &mut self,
                archive: &mut $crate::archive::Archive<'_>,
            ) -> Result<(), $crate::archive::Damaged> {
                archive.$which(self)
            }
        }
    };
}
pub(crate) use option;

/// Implements `State` for numbers, as little-endian bytes.
macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl State for $number {
            fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
                *self = Self::from_le_bytes(archive.bytes(self.to_le_bytes())?);
                Ok(())
            }
        }

        option!($number, maybe);
    )*};
}

numbers!(f64, u32, u64, usize);

impl State for bool {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        let [byte] = archive.bytes([u8::from(*self)])?;
        *self = match byte {
            0 => false,
            1 => true,
            _ => return Err(Damaged),
        };
        Ok(())
    }
}

impl<A: State, B: State> State for (A, B) {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        self.0.archive(archive)?;
        self.1.archive(archive)
    }
}

impl<A: State, B: State, C: State> State for (A, B, C) {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        self.0.archive(archive)?;
        self.1.archive(archive)?;
        self.2.archive(archive)
    }
}

/// A slice has no length in the archive.
impl<T: State> State for [T] {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        self.iter_mut().try_for_each(|own| own.archive(archive))
    }
}

impl<T: State> State for Vec<T> {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        self[..].archive(archive)
    }
}

impl<T: State, const N: usize> State for [T; N] {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        self[..].archive(archive)
    }
}

impl<T: State> State for Box<T> {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        (**self).archive(archive)
    }
}

/// Archives some fields of a value, one after the other.
macro_rules! state_of {
    ($own:ident, $archive:ident, $($field:tt),*) => {{
        $($crate::archive::State::archive(&mut $own.$field, $archive)?;)*
        Ok(())
    }};
}
pub(crate) use state_of;

/// Implements `State` for a type, by those of its fields that change during a simulation.
macro_rules! state {
    ($kind:ty { $($field:tt),* $(,)? }) => {
        impl $crate::archive::State for $kind {
            fn archive(
                &mut self,
                archive: &mut $crate::archive::Archive<'_>,
            ) -> Result<(), $crate::archive::Damaged> {
                $crate::archive::state_of!(self, archive, $($field),*)
            }
        }
    };
}
pub(crate) use state;

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Default, PartialEq)]
    struct Sample {
        x: Vec<f64>,
        n: u32,
        is_on: bool,
    }
    state!(Sample { x, n, is_on });

    fn written(state: &mut impl State) -> Vec<u8> {
        let mut bytes = Vec::new();
        state.archive(&mut Archive::Write(&mut bytes)).unwrap();
        bytes
    }

    #[test]
    fn archive_read_back_to_the_last_bit() {
        let mut state = Sample {
            x: vec![0.1, -0.0, f64::NAN],
            n: 7,
            is_on: true,
        };
        let bytes = written(&mut state);
        let mut other = Sample {
            x: vec![0.0; 3],
            ..Sample::default()
        };
        let mut archive = Archive::Read(&bytes);
        other.archive(&mut archive).unwrap();
        assert!(archive.is_empty());
        assert_eq!(written(&mut other), bytes);
    }

    #[test]
    fn archive_of_cut_or_wrong_bytes_is_damaged() {
        let mut state = Sample {
            x: vec![1.0; 3],
            n: 7,
            is_on: true,
        };
        let bytes = written(&mut state);
        for cut in 0..bytes.len() {
            assert_eq!(
                state.archive(&mut Archive::Read(&bytes[..cut])),
                Err(Damaged)
            );
        }
        let mut wrong = bytes;
        *wrong.last_mut().unwrap() = 2;
        assert_eq!(state.archive(&mut Archive::Read(&wrong)), Err(Damaged));
    }

    #[test]
    fn archive_same_compares_without_changing_a_state() {
        let mut state = Sample {
            x: vec![0.0, f64::NAN],
            n: 7,
            is_on: true,
        };
        let bytes = written(&mut state);
        let mut size = 0;
        state.archive(&mut Archive::Count(&mut size)).unwrap();
        assert_eq!(size, bytes.len());
        let is_same = |state: &mut Sample, bytes: &[u8]| {
            let mut archive = Archive::Same(bytes);
            state.archive(&mut archive).is_ok() && archive.is_empty()
        };
        assert!(is_same(&mut state, &bytes));
        assert_eq!(written(&mut state), bytes);
        assert!(
            !is_same(&mut state, &bytes[1..]) && !is_same(&mut state, &[&bytes[..], &[0]].concat())
        );
        state.x[0] = -0.0; // only the sign bit differs
        assert!(!is_same(&mut state, &bytes));
    }

    #[test]
    fn archive_note_within_and_beyond_capacity() {
        let mut state = vec![1.0_f64; 8];
        for (room, is_noted) in [(63, false), (64, true), (200, true)] {
            let mut bytes = Vec::with_capacity(room);
            let before = (bytes.as_ptr(), bytes.capacity());
            let noted = state.archive(&mut Archive::Note(&mut bytes));
            assert_eq!(noted.is_ok(), is_noted || before.1 >= 64);
            assert_eq!((bytes.as_ptr(), bytes.capacity()), before);
        }
    }

    #[test]
    fn archive_list_with_wrong_length_is_damaged() {
        let mut list = vec![1.0_f64, 2.0];
        let mut bytes = Vec::new();
        Archive::Write(&mut bytes).list(&mut list).unwrap();
        let mut other: Vec<f64> = Vec::new();
        Archive::Read(&bytes).list(&mut other).unwrap();
        assert_eq!(other, list);
        bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(Archive::Read(&bytes).list(&mut other), Err(Damaged));
    }
}
