//! The table of methods.

/// Largest ωT of a stable undamped mode (see `MethodProperties::omega_step_max`).
pub(super) const BM4_LIMIT: f64 = 3.164;

/// A method of stepping a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MeshMethod {
    /// The scheme of CORDIS-ANIMA.
    Ca,
    /// CA in two passes: the second cancels the leading error of the pitch (Takahashi & Imada 1984).
    Ca2p,
    /// The symmetric splitting of order 4 with six stages, SRKN6b (Blanes & Moan 2002).
    Bm4,
    /// Invariant energy quadratisation link by link, one linear system a step (Ducceschi et al. 2021).
    Ieq,
}

/// Properties of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MethodProperties {
    /// Its name in scores and plans.
    pub(crate) name: &'static str,
    /// Order of convergence of an undamped linear body.
    pub(crate) order: u32,
    /// Order with non-linear links.
    pub(crate) order_nonlinear: u32,
    /// Rough number of evaluations of all links per step: the unit of cost. For implicit methods: measured for a mesh
    /// of some hundred masses under moderate strikes.
    pub(crate) passes: f64,
    /// Largest ωT at which an undamped mode is stable; `None`: no limit.
    pub(crate) omega_step_max: Option<f64>,
}

impl MeshMethod {
    /// All methods: explicit ones by rising cost, then the implicit one.
    pub(crate) const ALL: [Self; 4] = [Self::Ca, Self::Ca2p, Self::Bm4, Self::Ieq];

    /// Properties of the method.
    pub(crate) const fn properties(self) -> MethodProperties {
        match self {
            Self::Ca => MethodProperties {
                name: "ca",
                order: 2,
                order_nonlinear: 2,
                passes: 1.0,
                omega_step_max: Some(2.0),
            },
            Self::Ca2p => MethodProperties {
                name: "ca2p",
                order: 4,
                order_nonlinear: 2,
                passes: 2.0,
                omega_step_max: Some(3.464_101_615_137_754), // 2√3
            },
            Self::Bm4 => MethodProperties {
                name: "bm4",
                order: 4,
                order_nonlinear: 4,
                passes: 6.0,
                omega_step_max: Some(BM4_LIMIT),
            },
            Self::Ieq => MethodProperties {
                name: "ieq",
                order: 2,
                order_nonlinear: 2,
                passes: 12.0,
                omega_step_max: None,
            },
        }
    }
}
