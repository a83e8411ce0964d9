use super::*;

const ZERO: GuardianAction = GuardianAction::Send([0.0; 3]);
const PUSH: GuardianAction = GuardianAction::Send([1.0, 0.0, 0.0]);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn order(number: u16, force: f64) -> ForceCommand {
    ForceCommand {
        number,
        force: [force, 0.0, 0.0],
    }
}

/// Rules without lockstep, and the time at which the service has just answered a push of 1 N.
fn pushing() -> (GuardianRules, Instant) {
    let start_instant = Instant::now();
    let mut rules = GuardianRules::new(false, start_instant);
    assert_eq!(rules.next_action(start_instant), GuardianAction::Nothing);
    rules.take_order(order(1, 1.0), start_instant);
    assert_eq!(rules.next_action(start_instant), PUSH);
    assert_eq!(rules.next_action(start_instant), GuardianAction::Nothing);
    assert_eq!(rules.take_state(start_instant), (1, false));
    (rules, start_instant)
}

#[test]
fn rules_send_zero_once_to_a_silent_host() {
    let (mut rules, start_instant) = pushing();
    assert!(rules.next_deadline(start_instant) <= start_instant + HOST_SILENCE_MAX);
    assert_eq!(rules.next_action(start_instant + ms(49)), GuardianAction::Nothing);
    assert_eq!(rules.next_action(start_instant + ms(50)), ZERO);
    assert_eq!(rules.next_action(start_instant + ms(50)), GuardianAction::Nothing);
    assert_eq!(rules.take_state(start_instant + ms(51)), (1, true), "the host is told");
    for later in 51..5000 {
        assert_eq!(
            rules.next_action(start_instant + ms(later)),
            GuardianAction::Nothing,
            "{later}"
        );
    }
    // The service is back, and forces are passed on again.
    rules.take_order(order(2, 1.0), start_instant + ms(5000));
    assert_eq!(rules.next_action(start_instant + ms(5000)), PUSH);
    assert_eq!(rules.take_state(start_instant + ms(5001)), (2, false));
}

#[test]
fn silent_service_receives_zeros_and_is_gone_after_two_seconds() {
    let (mut rules, start_instant) = pushing();
    let (mut zero_count, mut gone_after, mut first_zero) = (0, None, None);
    for now in 0..4000 {
        let position = start_instant + ms(now);
        rules.take_order(order(now as u16, 1.0), position);
        match rules.next_action(position) {
            ZERO => {
                zero_count += 1;
                first_zero = first_zero.or(Some(now));
            }
            GuardianAction::Send(_) => assert_eq!(now, 0, "no force into silence"),
            GuardianAction::Gone => {
                gone_after = Some(now);
                break;
            }
            GuardianAction::Nothing => assert!(rules.next_deadline(position) > position),
        }
    }
    assert_eq!((first_zero, gone_after), (Some(30), Some(2000)));
    assert!((90..=100).contains(&zero_count), "20 ms apart: {zero_count}");
}

#[test]
fn rules_push_again_after_the_service_answers() {
    let (mut rules, start_instant) = pushing();
    rules.take_order(order(2, 1.0), start_instant);
    assert_eq!(rules.next_action(start_instant), PUSH);
    rules.take_order(order(3, 1.0), start_instant + ms(30));
    assert_eq!(rules.next_action(start_instant + ms(30)), ZERO);
    assert_eq!(rules.take_state(start_instant + ms(31)), (2, true));
    assert_eq!(
        rules.next_action(start_instant + ms(31)),
        GuardianAction::Nothing,
        "that order is old"
    );
    rules.take_order(order(4, 1.0), start_instant + ms(32));
    assert_eq!(rules.next_action(start_instant + ms(32)), PUSH);
}

#[test]
fn rules_send_a_slow_service_single_forces() {
    let (mut rules, start_instant) = pushing();
    rules.take_order(order(2, 1.0), start_instant);
    assert_eq!(rules.next_action(start_instant), PUSH);
    for number in 3..10 {
        rules.take_order(order(number, 2.0), start_instant + ms(5));
        assert_eq!(rules.next_action(start_instant + ms(5)), GuardianAction::Nothing);
    }
    rules.take_order(order(10, 0.0), start_instant + ms(6));
    assert_eq!(rules.next_action(start_instant + ms(6)), ZERO, "it waits for no reply");
    rules.take_order(order(11, 0.0), start_instant + ms(7));
    assert_eq!(
        rules.next_action(start_instant + ms(7)),
        GuardianAction::Nothing,
        "one is enough"
    );
    rules.take_order(order(12, 1.0), start_instant + ms(8));
    assert_eq!(rules.next_action(start_instant + ms(8)), GuardianAction::Nothing);
    assert_eq!(rules.take_state(start_instant + ms(9)), (10, false));
    assert_eq!(rules.next_action(start_instant + ms(9)), PUSH, "the newest");
    assert_eq!(rules.take_state(start_instant + ms(10)), (12, false));
}

#[test]
fn rules_in_lockstep_send_each_order_once() {
    let start_instant = Instant::now();
    let mut rules = GuardianRules::new(true, start_instant);
    for number in 0..3 {
        rules.take_order(order(number, 1.0), start_instant);
    }
    for _ in 0..3 {
        assert_eq!(rules.next_action(start_instant), PUSH);
    }
    let hours_later = start_instant + Duration::from_secs(7200);
    assert_eq!(rules.next_action(hours_later), GuardianAction::Nothing);
    for number in 0..3 {
        assert_eq!(rules.take_state(hours_later), (number, false));
    }
}
