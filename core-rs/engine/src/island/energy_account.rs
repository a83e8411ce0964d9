//! Accounts of energy, and what was made beyond them.

/// Made energy is told of from this part of what was there on.
const TOLD: f64 = 0.01;
/// And is a fault from this part on: twice what was there.
const BORNE: f64 = 1.0;

/// Energy that something took [J].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Account {
    /// What it took and has not given back.
    held: f64,
    /// The most that this was, together with the energy of what moved around it at that time.
    most: f64,
}

crate::archive::option!(Account, maybe);

crate::archive::state!(Account { held, most });

/// Energy that something made [J].
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct Gain {
    /// What it gave or stores beyond what it took.
    pub(crate) made: f64,
    /// What was there without that.
    pub(crate) of: f64,
    /// The step at which it was found.
    pub(crate) frame: u64,
}

crate::archive::option!(Gain, maybe);

crate::archive::state!(Gain { made, of, frame });

impl Account {
    /// Of what stores so much.
    pub(crate) fn new(stored: f64) -> Self {
        Self {
            held: stored,
            most: stored,
        }
    }

    pub(crate) fn take(&mut self, work: f64) {
        self.take_beside(work, 0.0);
    }

    /// Take work from what has so much energy `around` it after that.
    ///
    /// What it takes lowers one term of the sum as it raises the other, so the sum never counts energy that it made.
    pub(crate) fn take_beside(&mut self, work: f64, around: f64) {
        self.held += work;
        self.most = self.most.max(self.held + around);
    }

    /// Count what was stored where it began.
    pub(super) fn add_start(&mut self, start: f64) {
        (self.held, self.most) = (self.held + start, self.most + start);
    }

    /// Whether more was given than was ever taken, whatever is stored.
    pub(super) fn is_overdrawn(&self) -> bool {
        self.held < -TOLD * self.most
    }

    /// What was made where so much is stored, beside the energy of what moves around it.
    ///
    /// It is compared with the most that was there since the account began: what was lost since then makes no fault of it.
    pub(crate) fn gain(&mut self, stored: f64, around: f64, frame: u64) -> Gain {
        self.take_beside(0.0, around);
        let made = stored - self.held;
        // What pushes away from where it rests stores less than nothing.
        let of = self.most.max(-stored);
        Gain { made, of, frame }
    }
}

impl Gain {
    /// What is said of it.
    pub(crate) fn sentence(&self, module: &str, seconds: f64) -> String {
        let [made, of] = [self.made, self.of].map(joules);
        format!(
            "{module} created energy: {made} until {seconds:.3} s, where the system held {of}; it is too stiff for \
             the time step: reduce K or raise the rate"
        )
    }

    /// Whether it is worth telling.
    pub(crate) fn is_told(&self) -> bool {
        self.made > TOLD * self.of
    }

    /// Whether no render can stand it.
    pub(super) fn is_fault(&self) -> bool {
        self.made > BORNE * self.of
    }

    fn is_worse(&self, other: &Self) -> bool {
        self.made * other.of > other.made * self.of
    }

    /// The worse of two.
    pub(crate) fn worst(self, other: Option<Self>) -> Self {
        other.filter(|other| !self.is_worse(other)).unwrap_or(self)
    }
}

/// An energy with two digits and its unit.
fn joules(energy: f64) -> String {
    const UNITS: [(f64, &str); 6] = [
        (1e6, "MJ"),
        (1e3, "kJ"),
        (1.0, "J"),
        (1e-3, "mJ"),
        (1e-6, "µJ"),
        (1e-9, "nJ"),
    ];
    let fits = |unit: &&(f64, &str)| energy >= 0.995 * unit.0 && energy < 995.0 * unit.0;
    let Some((unit, name)) = UNITS.iter().find(fits) else {
        return format!("{energy:.1e} J");
    };
    let size = energy / unit;
    let digits = usize::from(size < 9.95);
    format!("{size:.digits$} {name}")
}
