//! The stream of ergons that struck.

/// Mass of an event ergon, relative to the struck mass: small enough that v' ≈ −v, as in the paper.
const MASS_RATIO: f64 = 1e-4;

/// One ergon.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErgonRecord {
    /// Instant of the strike [s].
    pub time: f64,
    /// The struck MAT.
    pub mat: u32,
    /// Place in the score, as the timeline gives it.
    pub source: u32,
    /// Mass [kg].
    pub mass: f64,
    /// Velocity of the ergon before the strike, with its sign [m/s].
    pub speed: f64,
    /// Impulse given [N·s].
    pub impulse: f64,
}

impl ErgonRecord {
    /// An event ergon: v = V + p(m + M)/(2mM) (elastic collision of m and M, momentum p).
    pub(crate) fn event(time: f64, mat: usize, source: u32, struck_mass: f64, velocity: f64, impulse: f64) -> Self {
        let mass = MASS_RATIO * struck_mass;
        let speed = velocity + impulse * (mass + struck_mass) / (2.0 * mass * struck_mass);
        Self {
            time,
            mat: mat as u32,
            source,
            mass,
            speed,
            impulse,
        }
    }
}

/// An ergon and the frame in which it struck.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FramedErgon {
    pub(crate) frame: u64,
    pub(crate) record: ErgonRecord,
}

/// Ergons since the last [`ErgonStream::take_all`], if any are kept.
#[derive(Clone, Debug)]
pub(crate) struct ErgonStream(Option<Vec<FramedErgon>>);

impl ErgonStream {
    pub(crate) fn new(is_enabled: bool) -> Self {
        Self(is_enabled.then(Vec::new))
    }

    pub(crate) fn is_recording(&self) -> bool {
        self.0.is_some()
    }

    /// Number of kept ergons.
    pub(super) fn len(&self) -> usize {
        self.0.as_ref().map_or(0, Vec::len)
    }

    pub(crate) fn add(&mut self, frame: u64, record: ErgonRecord) {
        if let Some(records) = &mut self.0 {
            records.push(FramedErgon { frame, record });
        }
    }

    pub(crate) fn take_all(&mut self) -> Vec<FramedErgon> {
        self.0.as_mut().map(std::mem::take).unwrap_or_default()
    }
}
