//! Why a network is refused.

/// Why a network is refused; `module` is named as the composer wrote it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A parameter out of range, or a broken rule of the formalism.
    #[error("{module}: {message}")]
    Refused {
        /// The module at fault.
        module: String,
        /// A sentence.
        message: String,
    },
    /// The CA scheme diverges at this rate.
    #[error(
        "{module}: unstable at this rate: λmax(M⁻¹(K+2Z)) = {lambda:.6} must stay below 4; \
         it would take {oversampling} times the rate, a larger M, or a smaller K or Z"
    )]
    Unstable {
        /// The module that would move most.
        module: String,
        /// Largest eigenvalue of M⁻¹(K+2Z), algorithmic.
        lambda: f64,
        /// Factor of the rate that would make it stable.
        oversampling: u32,
    },
}
