//! One connection: reads the request, checks access, and answers.

use std::fs::File;
use std::io::{self, Read};
use std::net::{Shutdown, TcpStream};
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::answer::{self, Status};
use super::pace::Paced;
use super::request::{self, Request, RequestError};
use super::strangers::StrangerPlace;
use super::{Shared, Slot, access, assets, keys, player, viewer};

/// Bytes of a refused request that are read after the answer: if a socket is closed with unread bytes, it is reset and
/// the answer is lost.
const DRAIN: usize = 64 << 10;

/// Serves a connection. It keeps the `place` of a stranger until it is admitted, also while a refusal is sent.
pub(super) fn serve(stream: &TcpStream, place: StrangerPlace, shared: &Shared) {
    let asked = match request::read(stream, shared.options.limits.head) {
        Ok(request) => admit(request, shared),
        Err(RequestError::Refused(status)) => Err(status.into()),
        Err(RequestError::Gone) if place.is_sent_away() => Err(Status::Full.into()),
        Err(RequestError::Gone) => Err(ReplyError::Gone),
    };
    match asked {
        Ok(admitted) => {
            drop(place);
            end(reply(stream, &admitted, shared), stream, shared);
        }
        Err(error) => end(Err(error), stream, shared),
    }
}

/// A request with the key, which has a place among the connections.
struct Admitted<'a> {
    request: Request,
    /// The path below the key.
    name: String,
    _slot: Slot<'a>,
}

fn admit(request: Request, shared: &Shared) -> Result<Admitted<'_>, ReplyError> {
    let options = &shared.options;
    let name = access::check(&request, &options.key, shared.address)?.to_owned();
    let slot = Slot::take(&shared.tally.connections, options.limits.connections);
    Ok(Admitted {
        request,
        name,
        _slot: slot.ok_or(Status::Full)?,
    })
}

/// Counts how a connection ended, and sends the refusal if it was refused.
fn end(outcome: Result<(), ReplyError>, stream: &TcpStream, shared: &Shared) {
    let (tally, limits) = (&shared.tally, shared.options.limits);
    let counted = match &outcome {
        Ok(()) => &tally.served,
        Err(ReplyError::Slow) => &tally.dropped,
        Err(ReplyError::Gone | ReplyError::Refused(_)) => &tally.refused,
    };
    counted.fetch_add(1, Ordering::Relaxed);
    if let Err(ReplyError::Refused(status)) = outcome
        && let Ok(mut out) = Paced::new(stream, limits)
        && answer::refuse(&mut out, status).is_ok()
    {
        drain(stream, limits.head);
    }
}

/// Why a request did not get what it asked for.
enum ReplyError {
    /// The connection is closed: nobody can be answered.
    Gone,
    Refused(Status),
    Slow,
}

impl From<Status> for ReplyError {
    fn from(status: Status) -> Self {
        Self::Refused(status)
    }
}

impl From<io::Error> for ReplyError {
    fn from(_: io::Error) -> Self {
        Self::Slow
    }
}

fn reply(stream: &TcpStream, admitted: &Admitted, shared: &Shared) -> Result<(), ReplyError> {
    let options = &shared.options;
    let Admitted { request, name, .. } = admitted;
    if let Some(key) = &request.upgrade {
        let serve = match name.as_str() {
            "live" => viewer::send_to_page,
            "hands" if !options.keys.is_empty() => player::take_from_page,
            _ => return Err(Status::NotFound.into()),
        };
        let slot = Slot::take(&shared.tally.viewers, options.limits.viewers);
        let slot = slot.ok_or(Status::Full)?;
        answer::switch_protocols(&mut Paced::new(stream, options.limits)?, key)?;
        let rest = request.rest.clone();
        serve(stream.try_clone()?, rest, shared, slot);
        return Ok(());
    }
    let mut out = Paced::new(stream, options.limits)?;
    // A page requests the file to learn whether there is one; if not, it shows the live piece.
    if name == "motion" && options.file.is_none() {
        return Ok(answer::no_content(&mut out)?);
    }
    if name == "hands" {
        let keys = keys::listed(&options.keys);
        return Ok(answer::send_bytes(
            &mut out,
            "application/json",
            keys.as_bytes(),
        )?);
    }
    let page = match name.as_str() {
        "motion" => Some((&options.file, "application/octet-stream")),
        "sound.wav" => Some((&options.sound, "audio/wav")),
        _ => None,
    };
    if let Some((path, kind)) = page {
        let path = path.as_ref().ok_or(Status::NotFound)?;
        let mut file = File::open(path).map_err(|_| Status::NotFound)?;
        let length = file.metadata()?.len();
        let bytes = answer::byte_range(request.range, length)?;
        answer::send_file(
            &mut out,
            kind,
            &mut file,
            length,
            bytes,
            request.range.is_some(),
        )?;
    } else {
        let (kind, text) = assets::find(name).ok_or(Status::NotFound)?;
        answer::send_bytes(&mut out, kind, text.as_bytes())?;
    }
    Ok(())
}

/// Reads remaining bytes, for a limited time and up to a limit.
fn drain(mut stream: &TcpStream, within: Duration) {
    let _ = stream.shutdown(Shutdown::Write);
    let _ = stream.set_read_timeout(Some(within.min(Duration::from_millis(500))));
    let mut bytes = [0; 4 << 10];
    let mut left = DRAIN;
    while let Ok(n @ 1..) = stream.read(&mut bytes)
        && n <= left
    {
        left -= n;
    }
}
