//! What changes of a running simulation as bytes: the same list of fields writes them and reads them back.
//!
//! An archive holds no lengths of what a plan fixes and no type names: it is read into a simulation of an equal plan. What
//! does not fit is refused; numbers are read to the last bit.

/// Bytes that are not the state of such a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("these bytes are not the state of this simulation")]
pub struct Damaged;

/// Where a state is written to, or read from.
#[derive(Debug)]
pub(crate) enum Archive<'a> {
    Write(&'a mut Vec<u8>),
    Read(&'a [u8]),
    /// How many bytes it would be.
    Count(&'a mut usize),
    /// Written where there is room, and refused where there is none: nothing is allocated.
    Note(&'a mut Vec<u8>),
    /// Refused unless the state is this one.
    Same(&'a [u8]),
}

/// What has a state.
pub(crate) trait State {
    /// Write the state, or replace it by the next of the archive.
    ///
    /// # Errors
    /// [`Damaged`] where the archive holds another state; this one is then of no use.
    fn archive(&mut self, archive: &mut Archive<'_>) -> Result<(), Damaged>;
}

impl Archive<'_> {
    fn bytes<const N: usize>(&mut self, own: [u8; N]) -> Result<[u8; N], Damaged> {
        match self {
            Self::Write(to) => {
                to.extend_from_slice(&own);
                Ok(own)
            }
            Self::Read(from) => {
                let (first, rest) = from.split_first_chunk().ok_or(Damaged)?;
                *from = rest;
                Ok(*first)
            }
            Self::Count(size) => {
                **size += N;
                Ok(own)
            }
            Self::Note(to) => {
                if to.capacity() - to.len() < N {
                    return Err(Damaged);
                }
                to.extend_from_slice(&own);
                Ok(own)
            }
            Self::Same(known) => {
                let (first, rest) = known.split_first_chunk().ok_or(Damaged)?;
                *known = rest;
                if *first == own { Ok(own) } else { Err(Damaged) }
            }
        }
    }

    /// A list whose length changes while it plays.
    pub(crate) fn list<T: State + Default>(&mut self, list: &mut Vec<T>) -> Result<(), Damaged> {
        let mut len = list.len();
        len.archive(self)?;
        if let Self::Read(from) = self {
            // Each entry takes a byte or more: no archive asks for more memory than it has.
            if len > from.len() {
                return Err(Damaged);
            }
            list.clear();
            list.resize_with(len, T::default);
        }
        list.iter_mut().try_for_each(|own| own.archive(self))
    }

    /// What comes and goes while it plays.
    pub(crate) fn maybe<T: State + Default>(&mut self, own: &mut Option<T>) -> Result<(), Damaged> {
        let mut is_there = own.is_some();
        is_there.archive(self)?;
        if is_there {
            own.get_or_insert_default().archive(self)
        } else {
            *own = None;
            Ok(())
        }
    }

    /// What is there at all frames or at none.
    pub(crate) fn fixed<T: State>(&mut self, own: &mut Option<T>) -> Result<(), Damaged> {
        let mut is_there = own.is_some();
        is_there.archive(self)?;
        match own {
            Some(own) if is_there => own.archive(self),
            None if !is_there => Ok(()),
            _ => Err(Damaged),
        }
    }

    /// Whether all of it was read, or was the same.
    pub(crate) fn is_empty(&self) -> bool {
        matches!(self, Self::Read([]) | Self::Same([]))
    }
}

/// An option is there at some frames only (`maybe`), or at all or none (`fixed`).
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

/// Numbers are little-endian.
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

/// As many as there are.
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

/// Some fields of a value, one after the other.
macro_rules! state_of {
    ($own:ident, $archive:ident, $($field:tt),*) => {{
        $($crate::archive::State::archive(&mut $own.$field, $archive)?;)*
        Ok(())
    }};
}
pub(crate) use state_of;

/// The fields of a type that change while it plays.
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
    struct Own {
        x: Vec<f64>,
        n: u32,
        is_on: bool,
    }
    state!(Own { x, n, is_on });

    fn written(own: &mut impl State) -> Vec<u8> {
        let mut bytes = Vec::new();
        own.archive(&mut Archive::Write(&mut bytes)).unwrap();
        bytes
    }

    #[test]
    fn is_read_to_the_last_bit() {
        let mut own = Own {
            x: vec![0.1, -0.0, f64::NAN],
            n: 7,
            is_on: true,
        };
        let bytes = written(&mut own);
        let mut other = Own {
            x: vec![0.0; 3],
            ..Own::default()
        };
        let mut archive = Archive::Read(&bytes);
        other.archive(&mut archive).unwrap();
        assert!(archive.is_empty());
        assert_eq!(written(&mut other), bytes);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let mut own = Own {
            x: vec![1.0; 3],
            n: 7,
            is_on: true,
        };
        let bytes = written(&mut own);
        for cut in 0..bytes.len() {
            assert_eq!(own.archive(&mut Archive::Read(&bytes[..cut])), Err(Damaged));
        }
        let mut wrong = bytes;
        *wrong.last_mut().unwrap() = 2;
        assert_eq!(own.archive(&mut Archive::Read(&wrong)), Err(Damaged));
    }

    #[test]
    fn a_state_is_compared_and_stays() {
        let mut own = Own {
            x: vec![0.0, f64::NAN],
            n: 7,
            is_on: true,
        };
        let bytes = written(&mut own);
        let mut size = 0;
        own.archive(&mut Archive::Count(&mut size)).unwrap();
        assert_eq!(size, bytes.len());
        let is_same = |own: &mut Own, bytes: &[u8]| {
            let mut archive = Archive::Same(bytes);
            own.archive(&mut archive).is_ok() && archive.is_empty()
        };
        assert!(is_same(&mut own, &bytes));
        assert_eq!(written(&mut own), bytes);
        assert!(
            !is_same(&mut own, &bytes[1..]) && !is_same(&mut own, &[&bytes[..], &[0]].concat())
        );
        own.x[0] = -0.0; // another bit
        assert!(!is_same(&mut own, &bytes));
    }

    #[test]
    fn a_state_is_noted_where_there_is_room() {
        let mut own = vec![1.0_f64; 8];
        for (room, is_noted) in [(63, false), (64, true), (200, true)] {
            let mut bytes = Vec::with_capacity(room);
            let before = (bytes.as_ptr(), bytes.capacity());
            let noted = own.archive(&mut Archive::Note(&mut bytes));
            assert_eq!(noted.is_ok(), is_noted || before.1 >= 64);
            assert_eq!((bytes.as_ptr(), bytes.capacity()), before);
        }
    }

    #[test]
    fn a_list_asks_for_no_more_than_there_is() {
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
