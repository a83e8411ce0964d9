//! Small random scenes: every kind of link, gesture, strike, coupling and drive.

use std::sync::Arc;

use ergon_engine::chance::Chance;
use ergon_engine::gesture::profile::Curve;
use ergon_engine::gesture::script::{ErgonKind, Gesture, Manner, Touch};
use ergon_engine::gesture::take::{Preparation, Take};
use ergon_engine::gesture::written::{Approach, WrittenPoints};
use ergon_engine::law::{Law, LawText};
use ergon_engine::maths;
use ergon_engine::network::{But, Contact, Network, Side, Term, Tie};
use ergon_engine::simulation::{OnFault, Simulation, SimulationOptions};
use ergon_engine::timeline::{DriveKind, DriveSource, Rain, Timeline};
use ergon_engine::units::Rate;

/// Length of a scene [s].
pub(crate) const LENGTH: f64 = 0.2;

/// Number of kinds of links that join two MATs.
pub(crate) const LINKS: usize = 9;

pub(crate) struct Scene {
    pub(crate) network: Network,
    pub(crate) timeline: Timeline,
    chance: Chance,
}

pub(crate) fn options(on_fault: OnFault) -> SimulationOptions {
    SimulationOptions {
        keeps_ledger: true,
        records_ergons: false,
        on_fault,
        threads: 1,
        is_unchecked: false,
    }
}

/// A hand's movement: 0 to 3 mm and back, over 0.12 s.
pub(crate) fn hand() -> Take {
    let t: Vec<f64> = (0..=24).map(|i| f64::from(i) * 5e-3).collect();
    let x: Vec<f64> = t.iter().map(|t| 1.5e-3 * (1.0 - maths::cos(52.0 * t))).collect();
    Take::new(&t, &x, Preparation::default()).unwrap()
}

impl Scene {
    pub(crate) fn new(hertz: f64, seed: u64) -> Self {
        let mut network = Network::new();
        network.part("scene", None);
        Self {
            network,
            timeline: Timeline::new(Rate::new(hertz).unwrap()),
            chance: Chance::new(i128::from(seed), "scene", "scene", 0, 0),
        }
    }

    /// A scene with some of everything.
    pub(crate) fn random(seed: u64) -> Self {
        let hertz = [8_000.0, 22_050.0, 44_100.0, 192_000.0][(seed % 4) as usize];
        let mut scene = Self::new(hertz, seed);
        let bells: Vec<usize> = (0..2 + scene.pick(3)).map(|i| scene.bell(i)).collect();
        for pair in bells.windows(2) {
            let kind = scene.pick(LINKS);
            let link = scene.link(kind, pair[0], pair[1]);
            if scene.pick(3) == 0 {
                let (start, stop) = (scene.draw(-0.05, 0.1), scene.draw(0.11, 0.2));
                let network = &scene.network;
                scene.timeline.couple(network, link, start, Some(stop)).unwrap();
            }
        }
        scene.moved_point(bells[0]);
        let key = scene.key();
        scene.strikes(&bells);
        for _ in 0..1 + scene.pick(4) {
            scene.gesture(key);
        }
        scene
    }

    pub(crate) fn simulation(&self, options: SimulationOptions) -> Simulation {
        Simulation::new(Arc::new(self.network.clone()), &self.timeline, options).unwrap()
    }

    pub(crate) fn n_frames(&self) -> usize {
        (LENGTH * self.timeline.rate.hertz()) as usize
    }

    pub(crate) fn draw(&mut self, low: f64, high: f64) -> f64 {
        self.chance.uniform(low, high)
    }

    pub(crate) fn pick(&mut self, n: usize) -> usize {
        (self.chance.uniform(0.0, n as f64) as usize).min(n - 1)
    }

    pub(crate) fn bell(&mut self, i: usize) -> usize {
        let tie = Tie::Tuned {
            f: self.draw(100.0, 1500.0),
            t60: Some(self.draw(0.1, 1.0)),
        };
        let (m, x0) = (self.draw(5e-3, 5e-2), self.draw(-1e-4, 1e-4));
        let bell = self.network.cel(&format!("bell{i}"), m, tie, 0.0, x0, 0.0);
        let first = bell.unwrap();
        let (len, weight) = (1, 1.0);
        let listened = vec![Term::Position { first, len, weight }];
        self.network.listen(&format!("bell{i}"), listened).unwrap();
        first
    }

    /// A link of one of the [`LINKS`] kinds.
    pub(crate) fn link(&mut self, kind: usize, a: usize, b: usize) -> usize {
        let but = But::plain(2e4, 0.0, 1e-5);
        let exact = But {
            contact: Contact::Exact,
            k: 1e6,
            ..but
        };
        let law = LawText {
            law: Some("2e3*d + 1e9*d**3"),
            damping: Some("0.02*v + 0.1*tanh(5*v)"),
            ..LawText::default()
        };
        let points = [(-1e-3, -3.0), (0.0, 0.0), (1e-4, 0.1), (1e-3, 4.0)];
        let bent = LawText {
            points: Some(&points),
            ..LawText::default()
        };
        let name = format!("link{}", self.network.n_lia());
        let network = &mut self.network;
        match kind {
            0 => network.spring(&name, a, b, 3e3, 0.05, 0.0),
            1 => network.but(&name, a, b, but),
            2 => network.but(
                &name,
                a,
                b,
                But {
                    z: 0.5,
                    exponent: 1.5,
                    k: 2e5,
                    ..but
                },
            ),
            3 => network.but(
                &name,
                a,
                b,
                But {
                    z: 0.5,
                    is_clamped: true,
                    side: Side::Above,
                    ..but
                },
            ),
            4 => network.but(&name, a, b, exact),
            5 => network.but(
                &name,
                a,
                b,
                But {
                    z: 0.5,
                    is_clamped: true,
                    ..exact
                },
            ),
            6 => network.but(
                &name,
                a,
                b,
                But {
                    exponent: 2.5,
                    k: 1e9,
                    side: Side::Above,
                    ..exact
                },
            ),
            7 => network.lnl(&name, a, b, Arc::new(Law::new(&law).unwrap()), 1e-4),
            _ => network.lnl(&name, a, b, Arc::new(Law::new(&bent).unwrap()), 0.0),
        }
        .unwrap()
    }

    /// A point on the path of a take, tied to a MAT by a soft spring; also a constant force on that MAT.
    pub(crate) fn moved_point(&mut self, mat: usize) {
        let point = self.network.mas("point", 1.0, 0.0, 0.0).unwrap();
        self.network.set_imposed(point);
        self.network.spring("hold", point, mat, 500.0, 0.02, 0.0).unwrap();
        let path = hand().placed(0.03, 0.5, 1.0, false).unwrap();
        let timeline = &mut self.timeline;
        timeline
            .drive(point, DriveKind::Position, DriveSource::Take(path), true)
            .unwrap();
        timeline
            .drive(mat, DriveKind::Force, DriveSource::Constant(-0.05), true)
            .unwrap();
    }

    /// A key that meets the first bell, plain or with a second mass and a stop inside.
    fn key(&mut self) -> usize {
        self.network.part("key", None);
        let tie = Tie::Tuned {
            f: self.draw(4.0, 10.0),
            t60: Some(0.6),
        };
        let m = self.draw(0.05, 0.1);
        let struck = self.network.cel("m", m, tie, 0.0, 0.0, 0.0).unwrap();
        if self.pick(2) == 0 {
            let inner = self.network.mas("inner", 0.02, 0.0, 0.0).unwrap();
            self.network.spring("felt", struck, inner, 4e3, 2.0, 0.0).unwrap();
            let rail = self.network.mas("rail", 1.0, 0.02, 0.0).unwrap();
            self.network.set_imposed(rail);
            let stop = self.link(1, inner, rail);
            assert!(stop > 0);
            let timeline = &mut self.timeline;
            timeline
                .drive(inner, DriveKind::Force, DriveSource::Constant(-0.2), true)
                .unwrap();
            timeline
                .drive(rail, DriveKind::Position, DriveSource::Constant(0.02), true)
                .unwrap();
        }
        let kind = self.pick(LINKS);
        self.network.part("joint", None);
        self.link(kind, struck, 0);
        self.timeline.add_key("key", struck)
    }

    fn strikes(&mut self, bells: &[usize]) {
        for (i, &bell) in bells.iter().enumerate() {
            let (position, speed) = (self.draw(0.0, 0.15), self.draw(-300.0, 300.0));
            let network = &self.network;
            let timeline = &mut self.timeline;
            timeline
                .strike(network, bell, position, speed * 1e-7, Some(0.0), i as u32)
                .unwrap();
            timeline
                .add_ergon(network, bell, position + 0.01, 1e-7, speed, i as u32)
                .unwrap();
        }
        let rain = Rain {
            rate: 40.0,
            duration: Some(0.0),
            start: 0.0,
            stop: 0.15,
            impulse: (-1e-5, 1e-5),
            window: (0.0, f64::INFINITY),
            source: 7,
        };
        let chance = |member| Chance::new(3, "strikes", "rain", member, 0);
        self.timeline.rain(&self.network, bells, &rain, chance).unwrap();
    }

    fn gesture(&mut self, key: usize) {
        let mut t = vec![self.draw(-0.01, 0.12)];
        let mut x = vec![self.draw(-1e-3, 1e-3)];
        let mut method = vec![Approach::Path(Curve::Smooth)];
        for _ in 0..self.pick(4) {
            t.push(t[t.len() - 1] + self.draw(4e-3, 4e-2));
            let (last, next) = (x[x.len() - 1], self.draw(-3e-3, 3e-3));
            let (kind, position) = match self.pick(5) {
                // There is no frame before the piece, so the first points cannot be reached by a throw.
                0 if t[t.len() - 1] > 1e-3 => (Approach::Throw, next),
                1 => (Approach::Path(Curve::Line), next),
                2 => (Approach::Path(Curve::Hold), last),
                _ => (Approach::Path(Curve::Smooth), next),
            };
            method.push(kind);
            x.push(position);
        }
        let written = WrittenPoints {
            t: &t,
            x: &x,
            approaches: &method,
            sources: &[],
        };
        let (touch, ergons) = [
            (Touch::Open, ErgonKind::Event),
            (Touch::Open, ErgonKind::Particle),
            (Touch::Tracked, ErgonKind::Event),
        ][self.pick(3)];
        let manner = Manner {
            touch,
            ergon_kind: ergons,
            grain: (self.pick(3) == 0).then(|| self.draw(1e-4, 5e-3)),
            join_seconds: [0.0, 2e-3, 0.02][self.pick(3)],
            force_max: (self.pick(4) == 0).then_some(20.0),
            is_layer: touch == Touch::Open && self.pick(3) == 0,
        };
        let gesture = Gesture::from_points(key, &written, manner).unwrap();
        self.timeline.add_gesture(gesture).unwrap();
    }
}
