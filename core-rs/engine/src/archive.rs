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
    WriteWithin(&'a mut Vec<u8>),
    /// Fails unless the state equals these bytes.
    Compare(&'a [u8]),
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
                let (leading_bytes, bytes_left) = from.split_first_chunk().ok_or(Damaged)?;
                *from = bytes_left;
                Ok(*leading_bytes)
            }
            Self::Count(size) => {
                **size += N;
                Ok(number)
            }
            Self::WriteWithin(to) => {
                if to.capacity() - to.len() < N {
                    return Err(Damaged);
                }
                to.extend_from_slice(&number);
                Ok(number)
            }
            Self::Compare(known) => {
                let (leading_bytes, bytes_left) = known.split_first_chunk().ok_or(Damaged)?;
                *known = bytes_left;
                if *leading_bytes == number {
                    Ok(number)
                } else {
                    Err(Damaged)
                }
            }
        }
    }

    /// A list whose length changes during a simulation.
    pub(crate) fn list<T: State + Default>(&mut self, list: &mut Vec<T>) -> Result<(), Damaged> {
        let mut list_length = list.len();
        list_length.archive(self)?;
        if let Self::Read(source_bytes) = self {
            // Each entry takes at least a byte: so no archive makes this allocate for more entries than it has bytes.
            if list_length > source_bytes.len() {
                return Err(Damaged);
            }
            list.clear();
            list.resize_with(list_length, T::default);
        }
        list.iter_mut().try_for_each(|entry| entry.archive(self))
    }

    /// An option that comes and goes during a simulation.
    pub(crate) fn optional<T: State + Default>(&mut self, state: &mut Option<T>) -> Result<(), Damaged> {
        let mut is_some = state.is_some();
        is_some.archive(self)?;
        if is_some {
            state.get_or_insert_default().archive(self)
        } else {
            *state = None;
            Ok(())
        }
    }

    /// An option that is either always or never there, as the plan says.
    pub(crate) fn fixed<T: State>(&mut self, state: &mut Option<T>) -> Result<(), Damaged> {
        let mut is_some = state.is_some();
        is_some.archive(self)?;
        match state {
            Some(state) if is_some => state.archive(self),
            None if !is_some => Ok(()),
            _ => Err(Damaged),
        }
    }

    /// Whether the archive was read, or compared, to its end.
    pub(crate) fn is_empty(&self) -> bool {
        matches!(self, Self::Read([]) | Self::Compare([]))
    }
}

/// Implements `State` for an option: one that comes and goes (`optional`), or is always or never there (`fixed`).
macro_rules! option {
    ($kind:ty, $which:ident) => {
        impl $crate::archive::State for Option<$kind> {
            fn archive(&mut self, archive: &mut $crate::archive::Archive<'_>) -> Result<(), $crate::archive::Damaged> {
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

        option!($number, optional);
    )*};
}

numbers!(f64, u32, u64, usize);

impl State for bool {
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged> {
        let [flag_byte] = archive.bytes([u8::from(*self)])?;
        *self = match flag_byte {
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
        self.iter_mut().try_for_each(|entry| entry.archive(archive))
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
        let mut state_bytes = Vec::new();
        state.archive(&mut Archive::Write(&mut state_bytes)).unwrap();
        state_bytes
    }

    #[test]
    fn archive_read_back_to_the_last_bit() {
        let mut sample_state = Sample {
            x: vec![0.1, -0.0, f64::NAN],
            n: 7,
            is_on: true,
        };
        let state_bytes = written(&mut sample_state);
        let mut restored_state = Sample {
            x: vec![0.0; 3],
            ..Sample::default()
        };
        let mut archive = Archive::Read(&state_bytes);
        restored_state.archive(&mut archive).unwrap();
        assert!(archive.is_empty());
        assert_eq!(written(&mut restored_state), state_bytes);
    }

    #[test]
    fn archive_of_cut_or_wrong_bytes_is_damaged() {
        let mut sample_state = Sample {
            x: vec![1.0; 3],
            n: 7,
            is_on: true,
        };
        let state_bytes = written(&mut sample_state);
        for cut in 0..state_bytes.len() {
            assert_eq!(
                sample_state.archive(&mut Archive::Read(&state_bytes[..cut])),
                Err(Damaged)
            );
        }
        let mut wrong_bytes = state_bytes;
        *wrong_bytes.last_mut().unwrap() = 2;
        assert_eq!(sample_state.archive(&mut Archive::Read(&wrong_bytes)), Err(Damaged));
    }

    #[test]
    fn archive_same_compares_without_changing_a_state() {
        let mut sample_state = Sample {
            x: vec![0.0, f64::NAN],
            n: 7,
            is_on: true,
        };
        let state_bytes = written(&mut sample_state);
        let mut byte_count = 0;
        sample_state.archive(&mut Archive::Count(&mut byte_count)).unwrap();
        assert_eq!(byte_count, state_bytes.len());
        let compares_equal = |sample_state: &mut Sample, state_bytes: &[u8]| {
            let mut archive = Archive::Compare(state_bytes);
            sample_state.archive(&mut archive).is_ok() && archive.is_empty()
        };
        assert!(compares_equal(&mut sample_state, &state_bytes));
        assert_eq!(written(&mut sample_state), state_bytes);
        assert!(
            !compares_equal(&mut sample_state, &state_bytes[1..])
                && !compares_equal(&mut sample_state, &[&state_bytes[..], &[0]].concat())
        );
        sample_state.x[0] = -0.0; // only the sign bit differs
        assert!(!compares_equal(&mut sample_state, &state_bytes));
    }

    #[test]
    fn archive_note_within_and_beyond_capacity() {
        let mut sample_list = vec![1.0_f64; 8];
        for (room, is_noted) in [(63, false), (64, true), (200, true)] {
            let mut note_buffer = Vec::with_capacity(room);
            let buffer_before = (note_buffer.as_ptr(), note_buffer.capacity());
            let note_outcome = sample_list.archive(&mut Archive::WriteWithin(&mut note_buffer));
            assert_eq!(note_outcome.is_ok(), is_noted || buffer_before.1 >= 64);
            assert_eq!((note_buffer.as_ptr(), note_buffer.capacity()), buffer_before);
        }
    }

    #[test]
    fn archive_list_with_wrong_length_is_damaged() {
        let mut sample_list = vec![1.0_f64, 2.0];
        let mut list_bytes = Vec::new();
        Archive::Write(&mut list_bytes).list(&mut sample_list).unwrap();
        let mut restored_list: Vec<f64> = Vec::new();
        Archive::Read(&list_bytes).list(&mut restored_list).unwrap();
        assert_eq!(restored_list, sample_list);
        list_bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(Archive::Read(&list_bytes).list(&mut restored_list), Err(Damaged));
    }
}
