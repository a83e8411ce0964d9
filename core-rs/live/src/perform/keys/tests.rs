//! A device that is lost and found again.

use super::*;
use crate::perform::tests::unplugged::Unplugged;

/// A motor keeps its heat while its cable is unplugged and plugged in again.
#[test]
fn reconnected_device_keeps_its_heat() {
    let url = DeviceUrl::parse("emul:?mass=0.05&damping=1&stiffness=1000").unwrap();
    let key = device::open(&url).unwrap();
    let device_config = DeviceConfig {
        url,
        calibration: Vec::new(),
        force_limit: None,
        period: 1e-3,
        canceller: WaitCanceller::default(),
    };
    let unplugged_device = Box::new(Unplugged { key, left: 5_000 });
    let keyboard = Keyboard::from_device(unplugged_device, device_config, vec![(0, 0)]);
    let (commands, mut received_commands) = RingBuffer::new(4);
    let (mut keyboard_slot, reconnector) = keyboard.split(0, Arc::new(Mutex::new(commands)));
    assert!(keyboard_slot.receive(keyboard_slot.deadline()), "where it is, first");
    while keyboard_slot.is_open() {
        keyboard_slot.set_force(0, 20.0);
        if keyboard_slot.send() {
            keyboard_slot.receive(keyboard_slot.deadline());
        }
    }
    let patience = Instant::now() + Duration::from_secs(60);
    let returned_device = loop {
        assert!(Instant::now() < patience, "it is found again");
        match received_commands.pop() {
            Ok(Command::ReopenedKeyboard(_, guarded_device)) => break guarded_device,
            _ => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let motor_heat = returned_device.memory().heat()[0];
    drop(reconnector);
    // Three seconds at full force after a rise of two seconds: 1 - exp(-3.6/10), then half a second of cooling.
    assert!((0.1..0.4).contains(&motor_heat), "{motor_heat}");
}
