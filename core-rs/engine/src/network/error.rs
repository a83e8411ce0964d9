//! Why a network is refused.

use std::collections::HashSet;

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
    #[error("{module}: {}", self.sentence())]
    Unstable {
        /// The module that would move most.
        module: String,
        /// Largest eigenvalue of M⁻¹(K+2Z), algorithmic.
        lambda: f64,
        /// Factor of the rate that would make it stable.
        oversampling: u32,
    },
    /// Several modules are at fault, each by itself.
    #[error("{}", join_lines(.0))]
    Several(Vec<Error>),
}

impl Error {
    /// Combines errors, keeping only the first of each module; numbered members of a module count as one module. `None`
    /// if there are no errors.
    pub(crate) fn combined(errors: impl IntoIterator<Item = Error>) -> Option<Self> {
        let mut known_modules = HashSet::new();
        let mut error_list: Vec<Error> = errors.into_iter().flat_map(Error::into_list).collect();
        error_list.retain(|error| known_modules.insert(error.module_without_number()));
        match error_list.len() {
            0 | 1 => error_list.pop(),
            _ => Some(Self::Several(error_list)),
        }
    }

    /// What is wrong, without the name of the module.
    pub fn sentence(&self) -> String {
        match self {
            Self::Refused { message, .. } => message.clone(),
            Self::Unstable {
                lambda, oversampling, ..
            } => format!(
                "unstable at this rate: λmax(M⁻¹(K+2Z)) is {lambda:.6} and must be below 4; \
                 use {oversampling} times the rate, a larger M, or a smaller K or Z"
            ),
            Self::Several(_) => self.to_string(),
        }
    }

    /// Name of the module at fault, without the number of a member.
    fn module_without_number(&self) -> String {
        let module_name = match self {
            Self::Refused { module, .. } | Self::Unstable { module, .. } => module,
            Self::Several(_) => return String::new(),
        };
        match module_name.rsplit_once('.') {
            Some((module_name, member)) if member.bytes().all(|byte| byte.is_ascii_digit()) => module_name.to_owned(),
            _ => module_name.clone(),
        }
    }

    /// Each fault by itself.
    pub fn into_list(self) -> Vec<Self> {
        match self {
            Self::Several(errors) => errors,
            error => vec![error],
        }
    }
}

fn join_lines(errors: &[Error]) -> String {
    let messages: Vec<String> = errors.iter().map(Error::to_string).collect();
    messages.join("\n")
}
