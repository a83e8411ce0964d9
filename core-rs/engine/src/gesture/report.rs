//! The report on one gesture: how well the key followed it.

/// How well a key followed a gesture, over the frames that the gesture ran.
#[derive(Clone, Copy, Debug)]
pub struct GestureReport {
    /// Number of ergons.
    pub n_ergons: u64,
    /// First instant at which it ran [s]; NaN if it never ran.
    pub start: f64,
    /// Last instant at which it ran [s]; NaN if it never ran.
    pub stop: f64,
    /// Largest |actual − asked| position of the loaded key [m].
    pub deviation_max: f64,
    /// Instant of `deviation_max` [s].
    pub deviation_max_instant: f64,
    /// The MAT of another part that pushed the key most at that instant.
    pub pushed_by_mat: Option<usize>,
    /// Sum of (actual − asked)² over the compared frames [m²].
    pub squared_deviation_sum: f64,
    /// Number of compared frames.
    pub n_compared_frames: u64,
    /// Lowest position of the free key, from the start of the gesture to the next gesture [m].
    pub position_min: f64,
    /// Highest position of the free key in that time [m].
    pub position_max: f64,
    /// Largest velocity step of one ergon [m/s].
    pub velocity_step_max: f64,
    /// Largest force of one ergon [N].
    pub force_max: f64,
    /// Number of steps that needed more than the force limit.
    pub n_missed_steps: u64,
    /// Whether it interrupted another gesture and joined its path only after its first point.
    pub is_first_point_missed: bool,
}

crate::archive::state!(GestureReport {
    n_ergons,
    start,
    stop,
    deviation_max,
    deviation_max_instant,
    pushed_by_mat,
    squared_deviation_sum,
    n_compared_frames,
    position_min,
    position_max,
    velocity_step_max,
    force_max,
    n_missed_steps,
    is_first_point_missed
});

impl Default for GestureReport {
    fn default() -> Self {
        Self {
            n_ergons: 0,
            start: f64::NAN,
            stop: f64::NAN,
            deviation_max: 0.0,
            deviation_max_instant: f64::NAN,
            pushed_by_mat: None,
            squared_deviation_sum: 0.0,
            n_compared_frames: 0,
            position_min: f64::INFINITY,
            position_max: f64::NEG_INFINITY,
            velocity_step_max: 0.0,
            force_max: 0.0,
            n_missed_steps: 0,
            is_first_point_missed: false,
        }
    }
}

impl GestureReport {
    /// Root of the mean square of actual − asked [m].
    pub fn rms(&self) -> f64 {
        if self.n_compared_frames == 0 {
            0.0
        } else {
            (self.squared_deviation_sum / self.n_compared_frames as f64).sqrt()
        }
    }
}
