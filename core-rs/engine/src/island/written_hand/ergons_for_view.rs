//! Sparks: the ergons of a voice as pages draw them. Ergons that lead along a path may come at every frame and are
//! merged, because 44,100 a second cannot be distinguished.

use crate::island::record::ErgonRecord;

/// Sparks that may be separate between two calls of [`Sparks::take_sparks`], before ergons are merged.
const SINGLE_SPARKS_MAX: usize = 14;
/// Most sparks of a voice between two calls of [`Sparks::take_sparks`]: the last two merge all ergons that find no
/// other room, one for each sign.
pub(crate) const SPARKS_MAX: usize = SINGLE_SPARKS_MAX + 2;
/// An ergon of a stream is merged with the last one of its sign that came less than this before it [s].
const MERGE_SECONDS: f64 = 1e-3;

/// Ergons of one sign that are shown as one.
#[derive(Clone, Copy, Debug, Default)]
struct Spark {
    first_ergon: ErgonRecord,
    /// Instant of the last [s].
    last_instant: f64,
    /// Sum of their impulses [N·s].
    impulse: f64,
    /// Sums of impulse · time since the first [N·s²], and of impulse · (speed − that of the first) [N·m].
    moments: [f64; 2],
    is_stream: bool,
}

impl Spark {
    fn new(ergon: &ErgonRecord, is_stream: bool) -> Self {
        Self {
            first_ergon: *ergon,
            last_instant: ergon.time,
            impulse: ergon.impulse,
            moments: [0.0; 2],
            is_stream,
        }
    }

    fn has_sign_of(&self, ergon: &ErgonRecord) -> bool {
        (self.impulse > 0.0) == (ergon.impulse > 0.0)
    }

    /// Whether an ergon of a stream continues it.
    fn continues(&self, ergon: &ErgonRecord) -> bool {
        self.is_stream && self.has_sign_of(ergon) && ergon.time - self.last_instant <= MERGE_SECONDS
    }

    fn add(&mut self, ergon: &ErgonRecord) {
        let first_ergon = &self.first_ergon;
        self.moments[0] += ergon.impulse * (ergon.time - first_ergon.time);
        self.moments[1] += ergon.impulse * (ergon.speed - first_ergon.speed);
        self.impulse += ergon.impulse;
        self.last_instant = ergon.time;
    }

    /// One ergon with the sum of the impulses; its instant and speed are means weighted by impulse.
    fn merged_ergon(&self) -> ErgonRecord {
        let [time_since, speed_offset] = self.moments.map(|moment| moment / self.impulse);
        ErgonRecord {
            time: self.first_ergon.time + time_since,
            speed: self.first_ergon.speed + speed_offset,
            impulse: self.impulse,
            ..self.first_ergon
        }
    }
}

/// The sparks of a voice since they were last taken.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sparks {
    /// (SPARKS_MAX); `None`: sparks are not watched.
    sparks: Option<Box<[Spark; SPARKS_MAX]>>,
    spark_count: usize,
}

impl Sparks {
    /// Whether sparks are watched.
    pub(crate) fn is_watched(&self) -> bool {
        self.sparks.is_some()
    }

    /// Note ergons from here on.
    pub(crate) fn start_watching(&mut self) {
        self.sparks = Some(Box::new([Spark::default(); SPARKS_MAX]));
        self.spark_count = 0;
    }

    /// Note an ergon: one of a stream, or a single strike.
    pub(crate) fn add(&mut self, ergon: &ErgonRecord, is_stream: bool) {
        let Some(sparks) = &mut self.sparks else {
            return;
        };
        if ergon.impulse == 0.0 || !ergon.impulse.is_finite() {
            return;
        }
        let mut newest_first = sparks[..self.spark_count].iter_mut().enumerate().rev();
        let joined_spark = newest_first.find(|(spark_index, spark)| {
            (is_stream && spark.continues(ergon)) || (*spark_index >= SINGLE_SPARKS_MAX && spark.has_sign_of(ergon))
        });
        match joined_spark {
            Some((_, spark)) => spark.add(ergon),
            None => {
                sparks[self.spark_count] = Spark::new(ergon, is_stream);
                self.spark_count += 1;
            }
        }
    }

    /// Report each spark, and begin again.
    pub(crate) fn take_sparks(&mut self, report_spark: impl FnMut(ErgonRecord)) {
        let spark_count = std::mem::take(&mut self.spark_count);
        let sparks = self.sparks.iter().flat_map(|spark_buffer| &spark_buffer[..spark_count]);
        sparks.map(Spark::merged_ergon).for_each(report_spark);
    }
}
