//! Points between masses: forces are divided among the masses, and positions gathered from them.

use crate::scheme::Scheme;
use crate::state::Body;

/// Add the forces on each proxy to its masses.
pub(crate) fn divide(scheme: &Scheme, body: &mut Body) {
    let Body { x, force, .. } = body;
    for proxy in &scheme.proxies {
        let pull = force[proxy.mat];
        if pull != 0.0 {
            proxy.each(|mat| x[mat], |mat, share| force[mat] += share * pull);
        }
    }
}

/// Note where proxies are, before anything moves.
pub(crate) fn note(scheme: &Scheme, body: &mut Body) {
    let Body { x, proxies, .. } = body;
    for (proxy, before) in scheme.proxies.iter().zip(proxies) {
        *before = x[proxy.mat];
    }
}

/// Put proxies where their masses have moved since [`note`].
pub(crate) fn gather(scheme: &Scheme, body: &mut Body) {
    let Body { x, d, proxies, .. } = body;
    for (proxy, before) in scheme.proxies.iter().zip(&*proxies) {
        x[proxy.mat] = proxy.sum(|mat| x[mat], |mat| x[mat]);
        // A difference of positions has fewer digits than their last steps.
        d[proxy.mat] = if proxy.is_moving() {
            x[proxy.mat] - before
        } else {
            proxy.sum(|mat| x[mat], |mat| d[mat])
        };
    }
}

/// Put proxies where their masses are, moving as these do.
pub(crate) fn join(scheme: &Scheme, body: &mut Body) {
    let Body { x, d, .. } = body;
    for proxy in &scheme.proxies {
        x[proxy.mat] = proxy.sum(|mat| x[mat], |mat| x[mat]);
        d[proxy.mat] = proxy.sum(|mat| x[mat], |mat| d[mat]);
    }
}
