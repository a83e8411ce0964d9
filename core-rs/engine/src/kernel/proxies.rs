//! Proxies, points between masses: their forces are divided among the masses, and their positions computed from those
//! of the masses.

use crate::scheme::Scheme;
use crate::state::ModuleState;

/// Add the force on each proxy to its masses, by their shares.
pub(crate) fn distribute_forces(scheme: &Scheme, modules: &mut ModuleState) {
    let ModuleState { x, force, .. } = modules;
    for proxy in &scheme.proxies {
        let proxy_force = force[proxy.mat];
        if proxy_force != 0.0 {
            proxy.for_each_share(|mat| x[mat], |mat, share| force[mat] += share * proxy_force);
        }
    }
}

/// Store the positions of proxies before anything moves.
pub(crate) fn record_positions(scheme: &Scheme, modules: &mut ModuleState) {
    let ModuleState {
        x,
        proxy_positions: proxies,
        ..
    } = modules;
    for (proxy, position_before) in scheme.proxies.iter().zip(proxies) {
        *position_before = x[proxy.mat];
    }
}

/// Move proxies to the positions that follow from their masses; for proxies that change their masses, the step is that
/// since [`record_positions`].
pub(crate) fn move_to_masses(scheme: &Scheme, modules: &mut ModuleState) {
    let ModuleState {
        x,
        d,
        proxy_positions: proxies,
        ..
    } = modules;
    for (proxy, position_before) in scheme.proxies.iter().zip(&*proxies) {
        x[proxy.mat] = proxy.weighted_sum(|mat| x[mat], |mat| x[mat]);
        // The weighted sum of last steps keeps more digits than a difference of positions.
        d[proxy.mat] = if proxy.is_moving() {
            x[proxy.mat] - position_before
        } else {
            proxy.weighted_sum(|mat| x[mat], |mat| d[mat])
        };
    }
}

/// Set positions and last steps of proxies from those of their masses.
pub(crate) fn set_from_masses(scheme: &Scheme, modules: &mut ModuleState) {
    let ModuleState { x, d, .. } = modules;
    for proxy in &scheme.proxies {
        x[proxy.mat] = proxy.weighted_sum(|mat| x[mat], |mat| x[mat]);
        d[proxy.mat] = proxy.weighted_sum(|mat| x[mat], |mat| d[mat]);
    }
}
