//! What became of a gesture.

/// What became of a gesture.
#[derive(Clone, Copy, Debug)]
pub struct Report {
    /// Ergons that struck.
    pub n_ergons: u64,
    /// First and last instants it ran [s]; NaN when it never did.
    pub start: f64,
    /// See `start`.
    pub stop: f64,
    /// Largest |done − asked| on the loaded key [m].
    pub worst: f64,
    /// When that was [s].
    pub worst_at: f64,
    /// The MAT of another part that pushed most, where it was worst.
    pub pushed_by: Option<usize>,
    /// Sum of (done − asked)² and number of frames compared.
    pub square: f64,
    /// See `square`.
    pub compared: u64,
    /// Lowest and highest position of the free key, up to the next gesture [m].
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// Largest velocity step of one ergon [m/s].
    pub strongest: f64,
    /// Largest force of one ergon [N].
    pub force_max: f64,
    /// Steps that needed more than the force limit.
    pub missed: u64,
    /// It cut another gesture and joined after its start.
    pub first_point_missed: bool,
}

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
    /// Root of the mean square of done − asked [m].
    pub fn rms(&self) -> f64 {
        if self.compared == 0 {
            0.0
        } else {
            (self.square / self.compared as f64).sqrt()
        }
    }
}
