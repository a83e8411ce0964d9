use super::*;

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
fn an_even_bank_runs_from_low_and_long_to_high_and_short() {
    let never = |_| unreachable!("nothing is drawn");
    let bank = bank(&form(3, Spread::Even, Place::Line), never).expect("bank");
    let of = |member: &BankCell| (member.f, member.t60);
    assert_eq!((of(&bank[0]), of(&bank[2])), ((20.0, 8.0), (10_000.0, 0.5)));
    assert!(close(bank[1].f, (20.0f64 * 10_000.0).sqrt(), 1e-14) && close(bank[1].t60, 2.0, 1e-14));
    assert_eq!(bank[1].position, [0.0, 0.0]);
}

#[test]
fn a_spiral_fills_the_disc_evenly() {
    let bank = bank(&form(1_000, Spread::Random, Place::Spiral), |i| {
        (0.5, i as f64 / 1e3)
    })
    .expect("bank");
    let radius = |cell: &BankCell| {
        let [x, y] = cell.position;
        (x * x + y * y).sqrt()
    };
    assert!(bank.iter().all(|cell| radius(cell) < 0.5));
    let inner = bank.iter().filter(|cell| radius(cell) < 0.25).count();
    assert_eq!(inner, 250, "a quarter of the area");
    let upper = bank.iter().filter(|cell| cell.position[1] > 0.0).count();
    assert!((490..=510).contains(&upper), "{upper}");
}

#[test]
fn bad_banks_are_refused() {
    let refused = |form: BankForm| bank(&form, |_| (0.5, 0.5)).is_err();
    let good = form(5, Spread::Even, Place::Line);
    assert!(!refused(good));
    assert!(refused(BankForm { count: 0, ..good }));
    assert!(refused(BankForm {
        count: 2_000_001,
        ..good
    }));
    assert!(refused(BankForm {
        f: (30.0, 20.0),
        ..good
    }));
    assert!(refused(BankForm {
        t60: (0.0, 20.0),
        ..good
    }));
    assert!(refused(BankForm {
        f: (20.0, f64::INFINITY),
        ..good
    }));
}

proptest! {
    #[test]
    fn drawn_members_lie_within(u in 0.0..1.0f64, w in 0.0..1.0f64) {
        let bank = bank(&form(2, Spread::Random, Place::Line), |_| (u, w)).expect("bank");
        for member in bank {
            prop_assert!((20.0..=10_000.0).contains(&member.f));
            prop_assert!((0.5..=8.0).contains(&member.t60));
            prop_assert!(close(crate::maths::log(member.f / 20.0), u * crate::maths::log(500.0), 1e-9));
        }
    }
}
