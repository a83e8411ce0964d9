//! The protocol of Haply's Inverse Service: JSON in a WebSocket, for one of the service's devices. It allocates.

use serde_json::{Value, json};

/// Longest message that is read.
pub const MESSAGE_BYTES_MAX: usize = 64 * 1024;

/// The state of one device, as the service reports it.
#[derive(Clone, Debug, PartialEq)]
pub struct HaplyState {
    /// Identifier of the device.
    pub id: String,
    /// Position of its cursor [m].
    pub position: [f64; 3],
    /// Whether each command advances the device by one period; only an emulated service reports this.
    pub in_lockstep: bool,
}

/// The command that sets a device's force [N].
pub fn force_message(id: &str, force: [f64; 3]) -> String {
    let [x, y, z] = force.map(|force| if force.is_finite() { force } else { 0.0 });
    json!({"inverse3": [{"device_id": id, "commands": {
        "set_cursor_force": {"vector": {"x": x, "y": y, "z": z}, "execute": true}}}]})
    .to_string()
}

/// Parse the state of device `id`, or of the first device; `None` if the message contains none.
pub fn parse_state(text: &str, id: Option<&str>) -> Option<HaplyState> {
    let message = parse_json(text)?;
    let devices = message.get("inverse3")?.as_array()?;
    let device = devices.iter().find(|device| {
        let device_name = device.get("device_id").and_then(Value::as_str);
        device_name.is_some() && id.is_none_or(|id| device_name == Some(id))
    })?;
    Some(HaplyState {
        id: device.get("device_id")?.as_str()?.to_owned(),
        position: parse_vector(device.get("state")?.get("cursor_position")?)?,
        in_lockstep: device.get("lockstep").and_then(Value::as_bool) == Some(true),
    })
}

/// A message with the state of a device, as the service writes it; `lockstep` is a field of emulated services only.
pub fn state_message(id: &str, position: [f64; 3], force: [f64; 3], lockstep: bool) -> String {
    let vector = |[x, y, z]: [f64; 3]| json!({"x": x, "y": y, "z": z});
    let mut device_json = json!({"device_id": id, "state": {
        "cursor_position": vector(position), "current_cursor_force": vector(force)}});
    if lockstep {
        device_json["lockstep"] = true.into();
    }
    json!({"session_id": 1, "inverse3": [device_json]}).to_string()
}

/// Parse the force [N] that a command sets for device `id`; `None` if it sets none.
pub fn parse_command(text: &str, id: &str) -> Option<[f64; 3]> {
    let message = parse_json(text)?;
    let devices = message.get("inverse3")?.as_array()?;
    let device = devices
        .iter()
        .find(|device| device.get("device_id").and_then(Value::as_str) == Some(id))?;
    parse_vector(device.get("commands")?.get("set_cursor_force")?.get("vector")?)
}

fn parse_json(text: &str) -> Option<Value> {
    (text.len() <= MESSAGE_BYTES_MAX)
        .then(|| serde_json::from_str(text).ok())
        .flatten()
}

fn parse_vector(value: &Value) -> Option<[f64; 3]> {
    let mut components = [0.0; 3];
    for (component, axis) in components.iter_mut().zip(["x", "y", "z"]) {
        *component = value.get(axis)?.as_f64().filter(|x: &f64| x.is_finite())?;
    }
    Some(components)
}
