use super::*;
use crate::maths::{atan2, log};

fn form(count: usize, spread: Spread, place: Place) -> BankForm {
    BankForm {
        count,
        f: (20.0, 10_000.0),
        t60: (0.5, 8.0),
        spread,
        place,
    }
}

#[test]
fn even_bank_of_falling_decays_and_rising_pitches() {
    let never_drawn = |_| unreachable!("nothing is drawn");
    let bank = bank(&form(3, Spread::Even, Place::Line), never_drawn, |_| 0.0).expect("bank");
    let pitch_and_decay = |member: &BankCell| (member.f, member.t60);
    assert_eq!(
        (pitch_and_decay(&bank[0]), pitch_and_decay(&bank[2])),
        ((20.0, 8.0), (10_000.0, 0.5))
    );
    assert!(close(bank[1].f, (20.0f64 * 10_000.0).sqrt(), 1e-14) && close(bank[1].t60, 2.0, 1e-14));
    assert_eq!(bank[1].position, [0.0, 0.0]);
}

#[test]
fn spiral_bank_fills_the_disc_evenly() {
    let bank = bank(
        &form(1_000, Spread::Random, Place::Spiral),
        |i| (0.5, i as f64 / 1e3),
        |_| 0.0,
    )
    .expect("bank");
    let cell_radius = |cell: &BankCell| {
        let [x, y] = cell.position;
        (x * x + y * y).sqrt()
    };
    assert!(bank.iter().all(|cell| cell_radius(cell) < 0.5));
    let inner_cells = bank.iter().filter(|cell| cell_radius(cell) < 0.25).count();
    assert_eq!(inner_cells, 250, "a quarter of the area");
    let upper_cells = bank.iter().filter(|cell| cell.position[1] > 0.0).count();
    assert!((490..=510).contains(&upper_cells), "{upper_cells}");
}

#[test]
fn galaxy_radii_are_inversely_proportional_to_cents() {
    let hole = 0.3;
    let bank = bank(
        &form(
            41,
            Spread::Even,
            Place::Galaxy {
                hole,
                angles: Angles::Even,
            },
        ),
        |_| (0.0, 0.0),
        |_| 0.0,
    )
    .expect("bank");
    let cents_span = 1200.0 * log(500.0) / log(2.0);
    let lowest_cents = hole * cents_span / (1.0 - hole); // cents from the pitch at which the radius would be infinite
    for cell in &bank {
        let [x, y] = cell.position;
        let cell_cents = lowest_cents + 1200.0 * log(cell.f / 20.0) / log(2.0);
        assert!(close((x * x + y * y).sqrt(), 0.5 * lowest_cents / cell_cents, 1e-12));
    }
    let picture_radius = |[x, y]: [f64; 2]| (x * x + y * y).sqrt();
    assert!(close(picture_radius(bank[0].position), 0.5, 1e-14));
    assert!(close(picture_radius(bank[40].position), 0.5 * hole, 1e-14));
}

#[test]
fn galaxy_of_listed_pitches_equals_a_range() {
    let galaxy_place = Place::Galaxy {
        hole: 0.4,
        angles: Angles::Even,
    };
    let ranged_bank = bank(&form(9, Spread::Even, galaxy_place), |_| (0.0, 0.0), |_| 0.0).expect("bank");
    let tunings: Vec<_> = ranged_bank.iter().map(|cell| (cell.f, cell.t60)).collect();
    for (item, other) in ranged_bank
        .iter()
        .zip(cells_at(&tunings, galaxy_place, |_| 0.0).expect("cells"))
    {
        assert!(close(item.position[0], other.position[0], 1e-12));
        assert!(close(item.position[1], other.position[1], 1e-12));
    }
    let unison_cells = cells_at(&[(440.0, 1.0); 3], galaxy_place, |_| 0.0).expect("cells");
    let picture_radius = |[x, y]: [f64; 2]| (x * x + y * y).sqrt();
    let is_on_rim = |cell: &BankCell| close(picture_radius(cell.position), 0.5, 1e-14);
    assert!(unison_cells.iter().all(is_on_rim));
}

#[test]
fn galaxy_radii_with_random_angles() {
    let hole = 0.3;
    let galaxy_cells = |angles| {
        let galaxy_place = Place::Galaxy { hole, angles };
        let draw_turn = |i: usize| ((i * 7919) % 1000) as f64 / 1000.0;
        bank(&form(400, Spread::Even, galaxy_place), |_| (0.0, 0.0), draw_turn).expect("bank")
    };
    let (even_cells, random_cells) = (galaxy_cells(Angles::Even), galaxy_cells(Angles::Random));
    for (i, (item, other)) in even_cells.iter().zip(&random_cells).enumerate() {
        let picture_radius = |[x, y]: [f64; 2]| (x * x + y * y).sqrt();
        assert!(close(
            picture_radius(item.position),
            picture_radius(other.position),
            1e-14
        ));
        let drawn_turn = ((i * 7919) % 1000) as f64 / 1000.0;
        let [x, y] = other.position;
        let cell_turn = atan2(y, x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
        let turn_error = (cell_turn - drawn_turn).abs();
        assert!(!(1e-12..=1.0 - 1e-12).contains(&turn_error), "{cell_turn} {drawn_turn}");
    }
}

#[test]
fn bad_banks_are_refused() {
    let refused = |form: BankForm| bank(&form, |_| (0.5, 0.5), |_| 0.0).is_err();
    let good_form = form(5, Spread::Even, Place::Line);
    assert!(!refused(good_form));
    assert!(refused(BankForm { count: 0, ..good_form }));
    assert!(refused(BankForm {
        count: 2_000_001,
        ..good_form
    }));
    for hole in [0.0, -0.1, 1.1, f64::NAN] {
        let place = Place::Galaxy {
            hole,
            angles: Angles::Even,
        };
        assert!(refused(BankForm { place, ..good_form }));
        assert!(cells_at(&[(440.0, 1.0)], place, |_| 0.0).is_err());
    }
    assert!(refused(BankForm {
        f: (30.0, 20.0),
        ..good_form
    }));
    assert!(refused(BankForm {
        t60: (0.0, 20.0),
        ..good_form
    }));
    assert!(refused(BankForm {
        f: (20.0, f64::INFINITY),
        ..good_form
    }));
}

proptest! {
    #[test]
    fn random_bank_members_lie_within_ranges(u in 0.0..1.0f64, w in 0.0..1.0f64) {
        let bank = bank(&form(2, Spread::Random, Place::Line), |_| (u, w), |_| 0.0).expect("bank");
        for member in bank {
            prop_assert!((20.0..=10_000.0).contains(&member.f));
            prop_assert!((0.5..=8.0).contains(&member.t60));
            prop_assert!(close(log(member.f / 20.0), u * log(500.0), 1e-9));
        }
    }
}
