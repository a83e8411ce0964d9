//! One connection: reads the request, checks access, and answers.

use std::fs::File;
use std::io::{self, Read};
use std::net::{Shutdown, TcpStream};
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::answer::{self, RefusalStatus};
use super::pace::PacedStream;
use super::pending_connections::PendingPlace;
use super::request::{self, Request, RequestError};
use super::{ConnectionSlot, ServerState, access, assets, keys, player, viewer};

/// Bytes of a refused request that are read after the answer: if a socket is closed with unread bytes, it is reset and
/// the answer is lost.
const DRAIN_BYTES_MAX: usize = 64 << 10;

/// Serves a connection. It keeps the `pending_place` of a stranger until it is admitted, also while a refusal is sent.
pub(super) fn serve_connection(stream: &TcpStream, pending_place: PendingPlace, state: &ServerState) {
    let admission = match request::read_request(stream, state.options.limits.head_timeout) {
        Ok(request) => admit(request, state),
        Err(RequestError::Refused(status)) => Err(status.into()),
        Err(RequestError::Closed) if pending_place.is_evicted() => Err(RefusalStatus::Full.into()),
        Err(RequestError::Closed) => Err(ReplyError::Closed),
    };
    match admission {
        Ok(admitted) => {
            drop(pending_place);
            count_and_refuse(reply(stream, &admitted, state), stream, state);
        }
        Err(error) => count_and_refuse(Err(error), stream, state),
    }
}

/// A request with the key, which has a place among the connections.
struct AdmittedRequest<'a> {
    request: Request,
    /// The path below the key.
    name: String,
    _slot: ConnectionSlot<'a>,
}

fn admit(request: Request, state: &ServerState) -> Result<AdmittedRequest<'_>, ReplyError> {
    let options = &state.options;
    let name = access::check(&request, &options.access_key, state.address)?.to_owned();
    let connection_slot = ConnectionSlot::take(&state.counts.connections, options.limits.connections);
    Ok(AdmittedRequest {
        request,
        name,
        _slot: connection_slot.ok_or(RefusalStatus::Full)?,
    })
}

/// Counts how a connection ended, and sends the refusal if it was refused.
fn count_and_refuse(outcome: Result<(), ReplyError>, stream: &TcpStream, state: &ServerState) {
    let (counts, server_limits) = (&state.counts, state.options.limits);
    let counter = match &outcome {
        Ok(()) => &counts.served,
        Err(ReplyError::Slow) => &counts.dropped,
        Err(ReplyError::Closed | ReplyError::Refused(_)) => &counts.refused,
    };
    counter.fetch_add(1, Ordering::Relaxed);
    if let Err(ReplyError::Refused(refusal_status)) = outcome
        && let Ok(mut paced_stream) = PacedStream::new(stream, server_limits)
        && answer::refuse(&mut paced_stream, refusal_status).is_ok()
    {
        discard_input(stream, server_limits.head_timeout);
    }
}

/// Why a request did not get what it asked for.
enum ReplyError {
    /// The connection is closed: nobody can be answered.
    Closed,
    Refused(RefusalStatus),
    Slow,
}

impl From<RefusalStatus> for ReplyError {
    fn from(status: RefusalStatus) -> Self {
        Self::Refused(status)
    }
}

impl From<io::Error> for ReplyError {
    fn from(_: io::Error) -> Self {
        Self::Slow
    }
}

fn reply(stream: &TcpStream, admitted: &AdmittedRequest, state: &ServerState) -> Result<(), ReplyError> {
    let options = &state.options;
    let AdmittedRequest { request, name, .. } = admitted;
    if let Some(upgrade_key) = &request.upgrade_key {
        let serve = match name.as_str() {
            "live" => viewer::serve_viewer,
            "hands" if !options.page_keys.is_empty() => player::serve_player,
            _ => return Err(RefusalStatus::NotFound.into()),
        };
        let viewer_slot = ConnectionSlot::take(&state.counts.viewers, options.limits.viewers);
        let viewer_slot = viewer_slot.ok_or(RefusalStatus::Full)?;
        answer::switch_protocols(&mut PacedStream::new(stream, options.limits)?, upgrade_key)?;
        let unread_bytes = request.unread_bytes.clone();
        serve(stream.try_clone()?, unread_bytes, state, viewer_slot);
        return Ok(());
    }
    let mut paced_stream = PacedStream::new(stream, options.limits)?;
    // A page requests the file to learn whether there is one; if not, it shows the live piece.
    if name == "motion" && options.motion_file.is_none() {
        return Ok(answer::no_content(&mut paced_stream)?);
    }
    if name == "hands" {
        let key_list = keys::key_list_json(&options.page_keys);
        return Ok(answer::send_bytes(
            &mut paced_stream,
            "application/json",
            key_list.as_bytes(),
        )?);
    }
    let page_file = match name.as_str() {
        "motion" => Some((&options.motion_file, "application/octet-stream")),
        "sound.wav" => Some((&options.sound_file, "audio/wav")),
        _ => None,
    };
    if let Some((file_path, media_type)) = page_file {
        let file_path = file_path.as_ref().ok_or(RefusalStatus::NotFound)?;
        let mut opened_file = File::open(file_path).map_err(|_| RefusalStatus::NotFound)?;
        let file_length = opened_file.metadata()?.len();
        let file_range = answer::byte_range(request.range, file_length)?;
        answer::send_file(
            &mut paced_stream,
            media_type,
            &mut opened_file,
            file_length,
            file_range,
            request.range.is_some(),
        )?;
    } else {
        let (media_type, file_text) = assets::find_asset(name).ok_or(RefusalStatus::NotFound)?;
        answer::send_bytes(&mut paced_stream, media_type, file_text.as_bytes())?;
    }
    Ok(())
}

/// Reads remaining bytes, for a limited time and up to a limit.
fn discard_input(mut stream: &TcpStream, time_limit: Duration) {
    let _ = stream.shutdown(Shutdown::Write);
    let _ = stream.set_read_timeout(Some(time_limit.min(Duration::from_millis(500))));
    let mut read_buffer = [0; 4 << 10];
    let mut bytes_left = DRAIN_BYTES_MAX;
    while let Ok(bytes_read @ 1..) = stream.read(&mut read_buffer)
        && bytes_read <= bytes_left
    {
        bytes_left -= bytes_read;
    }
}
