//! Links along one axis.

use std::collections::HashMap;
use std::sync::Arc;

use ergon_engine::law::LawText;
use ergon_engine::network::{Bristle, But, Dry};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

use super::Network;
use super::masses::{FollowingValue, to_following};
use crate::error::{from_engine, parse_choice};
use crate::law::{Law, entry, named_row};
use crate::named::LawUse;
use crate::words;

#[pymethods]
impl Network {
    /// Spring and damper between two MATs; the LIA's index.
    #[pyo3(signature = (name, a, b, *, K=0.0, Z=0.0, rest=0.0))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn r#ref(&mut self, name: &str, a: usize, b: usize, K: f64, Z: f64, rest: f64) -> PyResult<usize> {
        self.0.spring(name, a, b, K, Z, rest).map_err(from_engine)
    }

    /// One-sided contact of the striker a on b; the LIA's index.
    #[pyo3(signature = (name, a, b, *, K=0.0, Z=0.0, gap=0.0, side="below", contact="plain", restitution=1.0, exponent=1.0, clamp=false, steps=2))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn but(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        K: f64,
        Z: f64,
        gap: f64,
        side: &str,
        contact: &str,
        restitution: f64,
        exponent: f64,
        clamp: bool,
        steps: u32,
    ) -> PyResult<usize> {
        let side = parse_choice("side", side, words::CONTACT_SIDES)?;
        let contact = parse_choice("contact", contact, words::CONTACT_METHODS)?;
        let but_link = But {
            k: K,
            z: Z,
            gap,
            side,
            contact,
            restitution,
            steps,
            exponent,
            is_clamped: clamp,
        };
        self.0.but(name, a, b, but_link).map_err(from_engine)
    }

    /// A friction with memory between MATs a and b; the LIA's index.
    #[pyo3(signature = (name, a, b, *, sigma0, Fc, sigma1=0.0, sigma2=0.0, Fs=None, vs=1e-3))]
    #[allow(non_snake_case, clippy::too_many_arguments)]
    fn bristle(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        sigma0: f64,
        Fc: f64,
        sigma1: f64,
        sigma2: f64,
        Fs: Option<f64>,
        vs: f64,
    ) -> PyResult<usize> {
        let bristle = Bristle {
            stiffness: sigma0,
            damping: sigma1,
            viscosity: sigma2,
            level: Fc,
            static_level: Fs.unwrap_or(Fc),
            speed: vs,
        };
        self.0.bristle(name, a, b, bristle).map_err(from_engine)
    }

    /// Dry friction between MATs a and b that holds rigidly; the LIA's index.
    #[pyo3(signature = (name, a, b, *, F, static_level=None, speed=1e-3))]
    #[allow(non_snake_case)]
    fn dry(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        F: f64,
        static_level: Option<f64>,
        speed: f64,
    ) -> PyResult<usize> {
        let dry_friction = Dry {
            level: F,
            static_level: static_level.unwrap_or(F),
            speed,
        };
        self.0.dry(name, a, b, dry_friction).map_err(from_engine)
    }

    /// A link between MATs a and b with a law, at `rest` [m]; the LIA's index.
    #[pyo3(signature = (name, a, b, law, *, rest=0.0))]
    fn lnl(&mut self, name: &str, a: usize, b: usize, law: &Law, rest: f64) -> PyResult<usize> {
        self.0
            .lnl(name, a, b, Arc::new(law.0.clone()), rest)
            .map_err(from_engine)
    }

    /// A link with a law some of whose constants follow MATs, each as (MAT, offset, span, from, to); the LIA's index.
    #[pyo3(signature = (name, a, b, *, law, damping, constants, follows, rest=0.0))]
    #[allow(clippy::too_many_arguments)]
    fn following_lnl(
        &mut self,
        name: &str,
        a: usize,
        b: usize,
        law: Option<&str>,
        damping: Option<&str>,
        constants: HashMap<String, f64>,
        follows: Vec<(String, FollowingValue)>,
        rest: f64,
    ) -> PyResult<usize> {
        let law_text = LawText {
            law,
            damping,
            constants: constants.into_iter().collect(),
            ..LawText::default()
        };
        let follows = follows.into_iter();
        let following_values: Vec<_> = follows.map(|(name, value)| (name, to_following(value))).collect();
        self.0
            .following_lnl(name, (a, b), &law_text, rest, &following_values)
            .map_err(from_engine)
    }

    /// Every different law that has rows, and how many links have it.
    fn laws(&self) -> Vec<LawUse> {
        let network_laws = self.0.laws().into_iter();
        network_laws
            .map(|law| LawUse {
                rows: law.rows.iter().map(named_row).collect(),
                alone: law.n_single_links,
                in_runs: law.n_run_links,
            })
            .collect()
    }

    /// Compute laws by native code: each entry is (index in `laws`, address of the code).
    fn native(&mut self, entries: Vec<(usize, usize)>) -> PyResult<()> {
        let network_laws = self.0.laws();
        let mut entry_by_rows = HashMap::new();
        for (index, address) in entries {
            let used_law = network_laws.get(index).filter(|_| address != 0);
            let used_law = used_law.ok_or_else(|| PyIndexError::new_err("no law has this index"))?;
            // SAFETY: `ergon.instruments.native`, the only caller, passes what it compiled of these rows.
            entry_by_rows.insert(used_law.rows.clone(), unsafe { entry(address) });
        }
        // SAFETY: as above; compiled code is kept until the process ends.
        unsafe { self.0.set_native(&entry_by_rows) };
        Ok(())
    }
}
