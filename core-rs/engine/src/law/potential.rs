//! The energy of an expression: adaptive quadrature, seven Gauss points inside fifteen of Kronrod.
//!
//! Source: QUADPACK (Piessens, de Doncker-Kapenga, Überhuber, Kahaner 1983), rule `qk15`.

/// Nodes of the Kronrod rule on [0, 1) of the half interval, from the outside in; those with odd indices are Gauss
/// nodes.
const NODES: [f64; 7] = [
    0.991_455_371_120_812_6,
    0.949_107_912_342_758_5,
    0.864_864_423_359_769_1,
    0.741_531_185_599_394_4,
    0.586_087_235_467_691_1,
    0.405_845_151_377_397_2,
    0.207_784_955_007_898_47,
];
const KRONROD: [f64; 7] = [
    0.022_935_322_010_529_224,
    0.063_092_092_629_978_55,
    0.104_790_010_322_250_18,
    0.140_653_259_715_525_92,
    0.169_004_726_639_267_9,
    0.190_350_578_064_785_4,
    0.204_432_940_075_298_9,
];
const KRONROD_CENTRE: f64 = 0.209_482_141_084_727_82;
const GAUSS: [f64; 3] = [
    0.129_484_966_168_869_7,
    0.279_705_391_489_276_67,
    0.381_830_050_505_118_9,
];
const GAUSS_CENTRE: f64 = 0.417_959_183_673_469_4;

/// Weights of the fifteen points, from the near end on, that extrapolate their polynomial to the end of the interval.
/// Neither rule detects a kink between the end and the first point; such a kink shows as a difference between the
/// extrapolated and the true value.
const EDGE: [f64; 15] = edge();

const fn point(i: usize) -> f64 {
    match i {
        0..7 => NODES[i],
        7 => 0.0,
        _ => -NODES[14 - i],
    }
}

/// Lagrange weights for x = 1.
const fn edge() -> [f64; 15] {
    let mut weights = [1.0; 15];
    let mut weight_index = 0;
    while weight_index < 15 {
        let mut node_index = 0;
        while node_index < 15 {
            if weight_index != node_index {
                weights[weight_index] *= (1.0 - point(node_index)) / (point(weight_index) - point(node_index));
            }
            node_index += 1;
        }
        weight_index += 1;
    }
    weights
}

/// Error allowed for one interval, relative to ∫|f|. The sum over about fifty bisections stays below 1e-13, and
/// rounding alone (about 2e-16) never causes another bisection.
const TOLERANCE: f64 = 2e-15;
/// Most halvings of an interval: a jump then costs less than rounding does.
const DEPTH: u32 = 52;
/// Most intervals in all. A law with a few kinks needs a few hundred. A function that needs more is assumed to have no
/// integral, and the sum so far is returned.
const INTERVALS: usize = 10_000;

/// Ends of the first intervals, as fractions of d: laws have their detail (slack, detents) near rest.
const FIRST_ENDS: [f64; 5] = [1.0, 0.125, 0.015_625, 0.001_953_125, 0.0];
/// Most intervals that wait at once.
const PANELS_MAX: usize = FIRST_ENDS.len() + DEPTH as usize + 1;

/// ∫ f from 0 to `d`, to some 1e-13 of ∫|f|; kinks and jumps inside are found by bisection.
pub(super) fn integrate(f: impl Fn(f64) -> f64, d: f64) -> f64 {
    if d == 0.0 {
        return 0.0;
    }
    let panel_ends = FIRST_ENDS.windows(2);
    // The deepest panel comes first, so at most one panel of each depth waits. The fixed array avoids allocation while
    // a simulation steps.
    let mut pending_panels = [const { Panel::NONE }; PANELS_MAX];
    let mut n_waiting = 0;
    for panel_end in panel_ends {
        pending_panels[n_waiting] = Panel::new(&f, d * panel_end[1], d * panel_end[0], 0);
        n_waiting += 1;
    }
    let mut integral_scale: f64 = pending_panels[..n_waiting].iter().map(|panel| panel.size).sum();
    let mut integral_sum = 0.0;
    for _ in 0..INTERVALS {
        let Some(last_panel) = n_waiting.checked_sub(1) else {
            break;
        };
        n_waiting = last_panel;
        let panel = pending_panels[last_panel];
        // A narrow detent that coarse panels missed counts as soon as a panel finds it.
        integral_scale = f64::max(integral_scale, panel.size);
        if panel.error <= TOLERANCE * integral_scale || panel.depth == DEPTH {
            integral_sum += panel.integral;
            continue;
        }
        let panel_middle = panel.a + 0.5 * (panel.b - panel.a);
        pending_panels[last_panel] = Panel::new(&f, panel_middle, panel.b, panel.depth + 1);
        pending_panels[last_panel + 1] = Panel::new(&f, panel.a, panel_middle, panel.depth + 1);
        n_waiting = last_panel + 2;
    }
    let panels_left = pending_panels[..n_waiting].iter();
    panels_left.fold(integral_sum, |integral_sum, panel| integral_sum + panel.integral)
}

#[derive(Clone, Copy)]
struct Panel {
    a: f64,
    b: f64,
    depth: u32,
    integral: f64,
    error: f64,
    /// ∫|f|
    size: f64,
}

impl Panel {
    const NONE: Self = Self {
        a: 0.0,
        b: 0.0,
        depth: 0,
        integral: 0.0,
        error: 0.0,
        size: 0.0,
    };

    fn new(f: &impl Fn(f64) -> f64, a: f64, b: f64, depth: u32) -> Self {
        let (half_width, centre) = (0.5 * (b - a), 0.5 * (a + b));
        let centre_value = f(centre);
        // True value minus extrapolated value, at b and at a.
        let mut end_residuals = (f(b) - EDGE[7] * centre_value, f(a) - EDGE[7] * centre_value);
        let mut kronrod = KRONROD_CENTRE * centre_value;
        let mut gauss_sum = GAUSS_CENTRE * centre_value;
        let mut absolute_sum = KRONROD_CENTRE * centre_value.abs();
        for (i, (node, weight)) in NODES.iter().zip(KRONROD).enumerate() {
            let (value_below, value_above) = (f(centre - half_width * node), f(centre + half_width * node));
            kronrod += weight * (value_below + value_above);
            absolute_sum += weight * (value_below.abs() + value_above.abs());
            end_residuals.0 -= EDGE[i] * value_above + EDGE[14 - i] * value_below;
            end_residuals.1 -= EDGE[i] * value_below + EDGE[14 - i] * value_above;
            if i % 2 == 1 {
                gauss_sum += GAUSS[i / 2] * (value_below + value_above);
            }
        }
        let unseen_error = (1.0 - NODES[0]) * (end_residuals.0.abs() + end_residuals.1.abs());
        Self {
            a,
            b,
            depth,
            integral: half_width * kronrod,
            error: half_width.abs() * ((kronrod - gauss_sum).abs() + unseen_error),
            size: half_width.abs() * absolute_sum,
        }
    }
}
