//! Accounts of energy, and energy that was created beyond them.

/// Steps between two checks of the accounts.
pub(super) const CHECK_STEPS: u64 = 256;
/// The same for energies that take long to compute.
pub(super) const RARE_CHECK_STEPS: u64 = 16 * CHECK_STEPS;
/// Created energy is reported above this share of the energy that was there.
const REPORT_SHARE: f64 = 0.01;
/// It is a fault above this share: then there is twice as much energy as there was.
const FAULT_SHARE: f64 = 1.0;

/// Account of the energy that something took [J].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Account {
    /// Energy that it took and has not given back.
    held: f64,
    /// The most of `held` plus the energy of what moved around it at the time.
    reference: f64,
}

crate::archive::option!(Account, optional);

crate::archive::state!(Account { held, reference });

/// Energy that something created [J].
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct Gain {
    /// Energy given or stored beyond the energy taken.
    pub(crate) created: f64,
    /// Energy that was there without it.
    pub(crate) reference: f64,
    /// The step at which it was found.
    pub(crate) frame: u64,
}

crate::archive::option!(Gain, optional);

crate::archive::state!(Gain {
    created,
    reference,
    frame
});

impl Account {
    /// The account of something that stores `stored` [J] already.
    pub(crate) fn new(stored: f64) -> Self {
        Self {
            held: stored,
            reference: stored,
        }
    }

    pub(crate) fn take(&mut self, work: f64) {
        self.take_from_masses(work, 0.0);
    }

    /// Add work that was taken from masses whose energy is `moving_energy` after it.
    ///
    /// Work that is taken raises `held` and lowers `moving_energy`, so their sum never counts created energy.
    pub(crate) fn take_from_masses(&mut self, work: f64, moving_energy: f64) {
        self.held += work;
        self.reference = self.reference.max(self.held + moving_energy);
    }

    /// Add the energy that was stored when the account began.
    pub(super) fn add_start(&mut self, start: f64) {
        (self.held, self.reference) = (self.held + start, self.reference + start);
    }

    /// Whether more energy was given than was ever taken, even if none is stored.
    pub(super) fn is_overdrawn(&self) -> bool {
        self.held < -REPORT_SHARE * self.reference
    }

    /// The energy created so far, if `stored` is stored now and masses nearby have the energy `moving_energy`.
    ///
    /// It is compared with the most energy since the account began, so that losses since then do not turn it into a
    /// fault.
    pub(crate) fn gain(&mut self, stored: f64, moving_energy: f64, frame: u64) -> Gain {
        self.take_from_masses(0.0, moving_energy);
        let created = stored - self.held;
        // A link that pushes away from its rest position stores negative energy.
        let reference = self.reference.max(-stored);
        Gain {
            created,
            reference,
            frame,
        }
    }
}

impl Gain {
    /// The same where at least `reference_min` [J] was there.
    pub(crate) fn with_reference_min(self, reference_min: f64) -> Self {
        Self {
            reference: self.reference.max(reference_min),
            ..self
        }
    }

    /// The message about it.
    pub(crate) fn sentence(&self, module: &str, seconds: f64) -> String {
        let [created, reference] = [self.created, self.reference].map(joules);
        format!(
            "{module} created energy: {created} until {seconds:.3} s, where the system held {reference}; it is too \
             stiff for the time step: reduce K or raise the rate"
        )
    }

    /// Whether it is large enough to be reported.
    pub(crate) fn is_reportable(&self) -> bool {
        self.created > REPORT_SHARE * self.reference
    }

    /// Whether it is so large that the part has to stop.
    pub(super) fn is_fault(&self) -> bool {
        self.created > FAULT_SHARE * self.reference
    }

    fn is_worse(&self, other: &Self) -> bool {
        self.created * other.reference > other.created * self.reference
    }

    /// The worse of two.
    pub(crate) fn worse_of(self, other: Option<Self>) -> Self {
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
    let unit_fits = |unit: &&(f64, &str)| energy >= 0.995 * unit.0 && energy < 995.0 * unit.0;
    let Some((unit, unit_name)) = UNITS.iter().find(unit_fits) else {
        return format!("{energy:.1e} J");
    };
    let scaled_energy = energy / unit;
    let decimal_count = usize::from(scaled_energy < 9.95);
    format!("{scaled_energy:.decimal_count$} {unit_name}")
}
