//! A device that is lost and found again.

use super::*;
use crate::perform::tests::unplugged::Unplugged;

/// A motor keeps its heat while its cable is unplugged and plugged in again.
#[test]
fn reconnected_device_keeps_its_heat() {
    let url = Url::parse("emul:?mass=0.05&damping=1&stiffness=1000").unwrap();
    let key = device::open(&url).unwrap();
    let config = DeviceConfig {
        url,
        calibration: Vec::new(),
        force_limit: None,
        period: 1e-3,
        canceller: WaitCanceller::default(),
    };
    let brief = Box::new(Unplugged { key, left: 5_000 });
    let keyboard = Keyboard::from_device(brief, config, vec![(0, 0)]);
    let (commands, mut result) = RingBuffer::new(4);
    let (mut slot, reconnector) = keyboard.split(0, Arc::new(Mutex::new(commands)));
    assert!(slot.receive(slot.deadline()), "where it is, first");
    while slot.is_there() {
        slot.set_force(0, 20.0);
        if slot.send() {
            slot.receive(slot.deadline());
        }
    }
    let patience = Instant::now() + Duration::from_secs(60);
    let back = loop {
        assert!(Instant::now() < patience, "it is found again");
        match result.pop() {
            Ok(Command::Keys(_, guarded)) => break guarded,
            _ => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let heat = back.memory().heat()[0];
    drop(reconnector);
    // Three seconds at full force after a rise of two seconds: 1 - exp(-3.6/10), then half a second of cooling.
    assert!((0.1..0.4).contains(&heat), "{heat}");
}
