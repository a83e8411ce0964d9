//! Sparks: the ergons of a voice as pages draw them. Ergons that lead along a path may come at every frame and are
//! merged, because nobody sees 44,100 a second.

use crate::island::record::Record;

/// Sparks that may be separate between two calls of [`Sparks::take`], before ergons are merged.
const SINGLE_SPARKS_MAX: usize = 14;
/// Most sparks of a voice between two calls of [`Sparks::take`]: the last two merge all ergons that find no other room,
/// one for each sign.
pub(crate) const SPARKS_MAX: usize = SINGLE_SPARKS_MAX + 2;
/// An ergon of a stream is merged with the last one of its sign that came less than this before it [s].
const MERGE_SECONDS: f64 = 1e-3;

/// Ergons of one sign that are shown as one.
#[derive(Clone, Copy, Debug, Default)]
struct Spark {
    first: Record,
    /// Instant of the last [s].
    last: f64,
    /// Sum of their impulses [N·s].
    impulse: f64,
    /// Sums of impulse · time since the first [N·s²], and of impulse · (speed − that of the first) [N·m].
    moments: [f64; 2],
    is_stream: bool,
}

impl Spark {
    fn new(ergon: &Record, is_stream: bool) -> Self {
        Self {
            first: *ergon,
            last: ergon.time,
            impulse: ergon.impulse,
            moments: [0.0; 2],
            is_stream,
        }
    }

    fn is_like(&self, ergon: &Record) -> bool {
        (self.impulse > 0.0) == (ergon.impulse > 0.0)
    }

    /// Whether an ergon of a stream continues it.
    fn goes_on(&self, ergon: &Record) -> bool {
        self.is_stream && self.is_like(ergon) && ergon.time - self.last <= MERGE_SECONDS
    }

    fn add(&mut self, ergon: &Record) {
        let first_ergon = &self.first;
        self.moments[0] += ergon.impulse * (ergon.time - first_ergon.time);
        self.moments[1] += ergon.impulse * (ergon.speed - first_ergon.speed);
        self.impulse += ergon.impulse;
        self.last = ergon.time;
    }

    /// One ergon with the sum of the impulses; its instant and speed are means weighted by impulse.
    fn seen(&self) -> Record {
        let [time_since, speed_offset] = self.moments.map(|moment| moment / self.impulse);
        Record {
            time: self.first.time + time_since,
            speed: self.first.speed + speed_offset,
            impulse: self.impulse,
            ..self.first
        }
    }
}

/// The sparks of a voice since they were last taken.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sparks {
    /// (SPARKS_MAX); `None`: nobody watches.
    room: Option<Box<[Spark; SPARKS_MAX]>>,
    n: usize,
}

impl Sparks {
    /// Whether sparks are watched.
    pub(crate) fn are_watched(&self) -> bool {
        self.room.is_some()
    }

    /// Note ergons from here on.
    pub(crate) fn watch(&mut self) {
        self.room = Some(Box::new([Spark::default(); SPARKS_MAX]));
        self.n = 0;
    }

    /// Note an ergon: one of a stream, or a single strike.
    pub(crate) fn add(&mut self, ergon: &Record, is_stream: bool) {
        let Some(spark_room) = &mut self.room else {
            return;
        };
        if ergon.impulse == 0.0 || !ergon.impulse.is_finite() {
            return;
        }
        let mut newest_first = spark_room[..self.n].iter_mut().enumerate().rev();
        let joined_spark = newest_first.find(|(spark_index, spark)| {
            (is_stream && spark.goes_on(ergon)) || (*spark_index >= SINGLE_SPARKS_MAX && spark.is_like(ergon))
        });
        match joined_spark {
            Some((_, spark)) => spark.add(ergon),
            None => {
                spark_room[self.n] = Spark::new(ergon, is_stream);
                self.n += 1;
            }
        }
    }

    /// Tell each spark, and begin anew.
    pub(crate) fn take(&mut self, tell: impl FnMut(Record)) {
        let spark_count = std::mem::take(&mut self.n);
        let spark_room = self.room.iter().flat_map(|spark_room| &spark_room[..spark_count]);
        spark_room.map(Spark::seen).for_each(tell);
    }
}
