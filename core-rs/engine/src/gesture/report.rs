//! The report on one gesture: how well the key followed it.

/// How well a key followed a gesture, over the frames that the gesture ran.
#[derive(Clone, Copy, Debug)]
pub struct Report {
    /// Number of ergons.
    pub n_ergons: u64,
    /// First instant at which it ran [s]; NaN if it never ran.
    pub start: f64,
    /// Last instant at which it ran [s]; NaN if it never ran.
    pub stop: f64,
    /// Largest |actual − asked| position of the loaded key [m].
    pub worst: f64,
    /// Instant of `worst` [s].
    pub worst_at: f64,
    /// The MAT of another part that pushed the key most at that instant.
    pub pushed_by: Option<usize>,
    /// Sum of (actual − asked)² over the compared frames [m²].
    pub square: f64,
    /// Number of compared frames.
    pub compared: u64,
    /// Lowest position of the free key, from the start of the gesture to the next gesture [m].
    pub low: f64,
    /// Highest position of the free key in that time [m].
    pub high: f64,
    /// Largest velocity step of one ergon [m/s].
    pub strongest: f64,
    /// Largest force of one ergon [N].
    pub force_max: f64,
    /// Number of steps that needed more than the force limit.
    pub missed: u64,
    /// Whether it interrupted another gesture and joined its path only after its first point.
    pub first_point_missed: bool,
}

crate::archive::state!(Report {
    n_ergons,
    start,
    stop,
    worst,
    worst_at,
    pushed_by,
    square,
    compared,
    low,
    high,
    strongest,
    force_max,
    missed,
    first_point_missed
});

impl Default for Report {
    fn default() -> Self {
        Self {
            n_ergons: 0,
            start: f64::NAN,
            stop: f64::NAN,
            worst: 0.0,
            worst_at: f64::NAN,
            pushed_by: None,
            square: 0.0,
            compared: 0,
            low: f64::INFINITY,
            high: f64::NEG_INFINITY,
            strongest: 0.0,
            force_max: 0.0,
            missed: 0,
            first_point_missed: false,
        }
    }
}

impl Report {
    /// Root of the mean square of actual − asked [m].
    pub fn rms(&self) -> f64 {
        if self.compared == 0 {
            0.0
        } else {
            (self.square / self.compared as f64).sqrt()
        }
    }
}
