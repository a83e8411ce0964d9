//! Python named tuples: results of the core, and structured arguments.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::IntoPyDict;

use crate::arrays::{ComplexArray, NumberArray};

/// The class of a named tuple.
struct NamedTupleClass {
    name: &'static str,
    doc: &'static str,
    fields: &'static [&'static str],
    class: PyOnceLock<Py<PyAny>>,
}

impl NamedTupleClass {
    const fn new(name: &'static str, doc: &'static str, fields: &'static [&'static str]) -> Self {
        Self {
            name,
            doc,
            fields,
            class: PyOnceLock::new(),
        }
    }

    fn get<'py>(&self, py: Python<'py>) -> PyResult<&Bound<'py, PyAny>> {
        let cached_class = self.class.get_or_try_init(py, || {
            let module_keywords = [("module", "ergon._core")].into_py_dict(py)?;
            let namedtuple = py.import("collections")?.getattr("namedtuple")?;
            let named_class = namedtuple.call((self.name, self.fields.to_vec()), Some(&module_keywords))?;
            named_class.setattr("__doc__", self.doc.trim())?;
            Ok::<_, PyErr>(named_class.unbind())
        })?;
        Ok(cached_class.bind(py))
    }
}

/// Declares results: structs of the core that Python receives as named tuples.
macro_rules! results {
    ($($(#[doc = $doc:literal])+ $name:ident { $($field:ident: $type:ty),+ $(,)? })+) => {
        $(
            $(#[doc = $doc])+
            #[derive(Clone)]
            pub(crate) struct $name { $(pub(crate) $field: $type),+ }

            impl $name {
                fn class() -> &'static NamedTupleClass {
                    static CLASS: NamedTupleClass =
                        NamedTupleClass::new(stringify!($name), concat!($($doc),+), &[$(stringify!($field)),+]);
                    &CLASS
                }
            }

            impl<'py> IntoPyObject<'py> for $name {
                type Target = PyAny;
                type Output = Bound<'py, PyAny>;
                type Error = PyErr;

                fn into_pyobject(self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                    Self::class().get(py)?.call1(($(self.$field,)+))
                }
            }
        )+

        fn result_classes() -> Vec<&'static NamedTupleClass> {
            vec![$($name::class()),+]
        }
    };
}

results! {
    /// An operation of a law and its operands: 0 is d, 1 is v, 2 + i is row i.
    LawRow { operation: &'static str, a: i32, b: i32, c: i32 }
    /// A function of the core that native code of a law calls.
    LawFunction { name: &'static str, address: usize }
    /// A law of a network: its rows, links with it alone in their run, and links in longer runs.
    LawUse { rows: Vec<LawRow>, alone: usize, in_runs: usize }
    /// A mode of a part: damped frequency [Hz], and decay [s], infinite without loss.
    Mode { f: f64, t60: f64 }
    /// Modes of a part, from low to high, with the motion of each mass.
    PartModes {
        poles: ComplexArray,
        shapes: ComplexArray,
        mats: Vec<usize>,
        is_certified: bool,
        n_laws: usize,
        n_contacts: usize,
    }
    /// The masses and links of some parts by themselves; each link has the slots of its ends, -1 for an end that is
    /// held.
    Elements {
        mats: Vec<usize>,
        masses: NumberArray<f64>,
        kinds: Vec<&'static str>,
        a: NumberArray<i64>,
        b: NumberArray<i64>,
        stiffness: NumberArray<f64>,
        damping: NumberArray<f64>,
        n_held: usize,
        ca_rate: Option<f64>,
    }
    /// Position [m], velocity [m/s] and acceleration [m/s²] of a path at one instant.
    PathPoint { x: f64, v: f64, a: f64 }
    /// A run of points of one kind, and the name of their part; for a modal part also the first mode, how many modes
    /// are looked at, and how many are computed.
    LookRun {
        part: String,
        first: usize,
        count: usize,
        kind: &'static str,
        why: Option<&'static str>,
        modes: Option<(usize, usize, usize)>,
    }
    /// A link that opens and closes, and its two MATs.
    LookContact { name: String, a: usize, b: usize }
    /// A chunk of a motion file: its kind, its instant [s] and the bytes of its payload.
    MotionChunk { kind: u16, seconds: f64, size: usize }
    /// A place on the bench [m].
    Place { x: f64, y: f64 }
    /// Lowest and highest of some positions, [m] or [rad].
    Range { low: f64, high: f64 }
    /// Impulse of a strike on a MAT [N·s], and its time [s].
    Impulse { at: f64, impulse: f64 }
    /// Results and cost of the trials of an island.
    TrialRecord { numbers: Vec<Option<f64>>, counts: Vec<Vec<u32>>, reason: Option<String> }
    /// How many modes of a body are computed, and how many it has.
    ModeCount { computed: usize, total: usize }
    /// The decisions of a plan on one island.
    IslandChoice {
        modules: usize,
        oversampling: u32,
        contact_substeps: usize,
        bodies: Vec<Vec<u32>>,
        counted_cost: Option<u32>,
        contact_order: u32,
    }
    /// A part with its own rate that is computed at every frame, and why.
    FullRatePart { name: String, why: String }
    /// The audible error, at its worst: pitch [cents], relative error of the T60, level of a third octave [dB],
    /// beginning of the first stroke and of a later one [s], level of a stroke [dB].
    AudibleError {
        cents: f64,
        t60: f64,
        third_octave_db: f64,
        first_stroke_s: f64,
        later_stroke_s: f64,
        stroke_db: f64,
    }
    /// Work of a plan's trials, and the most allowed, by the table of costs [s].
    TrialWork { done: f64, allowed: f64 }
    /// A part that became non-finite at a frame and was muted.
    MutedPart { name: String, frame: u64 }
    /// A part some of whose frames needed more than one step, because its links had stiffened.
    FinerPart { name: String, frames: u64, steps: u32 }
    /// A module whose steps made more energy than a hundredth of what was there.
    EnergyGain { name: String, frame: u64, sentence: String }
    /// The player and the key of an axis of a recording.
    RecordedAxis { player: String, key: String }
    /// An event of a recording: its tick, and a line of JSON.
    RecordedEvent { tick: u64, line: String }
    /// An event of a performance.
    PerformanceEvent { frame: u64, what: &'static str, number: f64 }
    /// An event of a performance's sound output or input, at a time since it was opened [s].
    SoundEvent { time: f64, sentence: String }
    /// The sound input of a performance.
    SoundInput {
        sentence: String,
        live: bool,
        gaps: u64,
        missing: u64,
        discarded: u64,
        recorded: Option<u64>,
        lost: u64,
        error: Option<String>,
    }
    /// A frame at which the silence of a panic begins or ends.
    SilenceEdge { frame: u64, begins: bool }
}

/// Classes of arguments; the bridge reads them as plain tuples.
static ARGUMENTS: [NamedTupleClass; 8] = [
    NamedTupleClass::new(
        "AxisCalibration",
        "What is known of an axis of a device.",
        &["number", "sign", "zero", "gain", "range", "force_max"],
    ),
    NamedTupleClass::new(
        "LiveHand",
        "A hand of a performance.",
        &["standin", "reach", "guidance", "response", "measured", "forces"],
    ),
    NamedTupleClass::new(
        "GuidanceSpring",
        "The spring and damper that lead a hand.",
        &["K", "Z", "follows_steps"],
    ),
    NamedTupleClass::new(
        "LiveBoard",
        "A device of a performance.",
        &["url", "axes", "force_max", "calibration"],
    ),
    NamedTupleClass::new(
        "RecordTarget",
        "Where a performance records its hands.",
        &["path", "axes", "about"],
    ),
    NamedTupleClass::new(
        "FrozenStem",
        "A frozen part of a performance.",
        &["path", "offset", "n_frames", "outputs"],
    ),
    NamedTupleClass::new(
        "MatValues",
        "K, Z and M of a MAT at one moment.",
        &["mat", "K", "Z", "M"],
    ),
    NamedTupleClass::new(
        "ModuleRange",
        "A range of modules in an output, and its weight.",
        &["first", "n", "weight"],
    ),
];

/// Add all classes to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let results = result_classes().into_iter();
    for class in results.chain(&ARGUMENTS) {
        module.add(class.name, class.get(module.py())?)?;
    }
    Ok(())
}
