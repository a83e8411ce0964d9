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
pub(crate) struct EnergyAccount {
    /// Energy that it took and has not given back.
    balance: f64,
    /// The most of `balance` plus the energy of what moved around it at the time.
    reference_energy: f64,
}

crate::archive::option!(EnergyAccount, optional);

crate::archive::state!(EnergyAccount {
    balance,
    reference_energy
});

/// Energy that something created [J].
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct EnergyGain {
    /// Energy given or stored beyond the energy taken.
    pub(crate) created_energy: f64,
    /// Energy that was there without it [J].
    pub(crate) reference_energy: f64,
    /// The step at which it was found.
    pub(crate) step: u64,
}

crate::archive::option!(EnergyGain, optional);

crate::archive::state!(EnergyGain {
    created_energy,
    reference_energy,
    step
});

impl EnergyAccount {
    /// The account of something that stores `stored_energy` [J] already.
    pub(crate) fn new(stored_energy: f64) -> Self {
        Self {
            balance: stored_energy,
            reference_energy: stored_energy,
        }
    }

    pub(crate) fn add_work(&mut self, work: f64) {
        self.add_work_of_masses(work, 0.0);
    }

    /// Add work that was taken from masses whose energy is `motion_energy` after it.
    ///
    /// Work that is taken raises `balance` and lowers `motion_energy`, so their sum never counts created energy.
    pub(crate) fn add_work_of_masses(&mut self, work: f64, motion_energy: f64) {
        self.balance += work;
        self.reference_energy = self.reference_energy.max(self.balance + motion_energy);
    }

    /// Add the energy that was stored when the account began.
    pub(super) fn add_start_energy(&mut self, start_energy: f64) {
        (self.balance, self.reference_energy) = (self.balance + start_energy, self.reference_energy + start_energy);
    }

    /// Whether more energy was given than was ever taken, even if none is stored.
    pub(super) fn is_overdrawn(&self) -> bool {
        self.balance < -REPORT_SHARE * self.reference_energy
    }

    /// The energy created so far, if `stored_energy` is stored now and masses nearby have the energy `motion_energy`.
    ///
    /// It is compared with the most energy since the account began, so that losses since then do not turn it into a
    /// fault.
    pub(crate) fn energy_gain(&mut self, stored_energy: f64, motion_energy: f64, step: u64) -> EnergyGain {
        self.add_work_of_masses(0.0, motion_energy);
        let created_energy = stored_energy - self.balance;
        // A link that pushes away from its rest position stores negative energy.
        let reference_energy = self.reference_energy.max(-stored_energy);
        EnergyGain {
            created_energy,
            reference_energy,
            step,
        }
    }
}

impl EnergyGain {
    /// The same, with a reference of at least `reference_energy_min` [J].
    pub(crate) fn with_reference_energy_min(self, reference_energy_min: f64) -> Self {
        Self {
            reference_energy: self.reference_energy.max(reference_energy_min),
            ..self
        }
    }

    /// The message about it.
    pub(crate) fn sentence(&self, module: &str, seconds: f64) -> String {
        let [created, reference] = [self.created_energy, self.reference_energy].map(energy_text);
        format!(
            "{module} created energy: {created} until {seconds:.3} s, where the system held {reference}; it is too \
             stiff for the time step: reduce K or raise the rate"
        )
    }

    /// Whether it is large enough to be reported.
    pub(crate) fn is_reportable(&self) -> bool {
        self.created_energy > REPORT_SHARE * self.reference_energy
    }

    /// Whether it is so large that the part has to stop.
    pub(super) fn is_fault(&self) -> bool {
        self.created_energy > FAULT_SHARE * self.reference_energy
    }

    fn is_worse(&self, other: &Self) -> bool {
        self.created_energy * other.reference_energy > other.created_energy * self.reference_energy
    }

    /// The worse of two.
    pub(crate) fn worse_of(self, other: Option<Self>) -> Self {
        other.filter(|other| !self.is_worse(other)).unwrap_or(self)
    }
}

/// An energy with two digits and its unit.
fn energy_text(energy: f64) -> String {
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
