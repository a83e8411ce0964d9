//! Connections that have not given the key: they have a bounded number of places, and a new one always gets a place.

use std::net::{IpAddr, Shutdown, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The connections whose request was not accepted yet, the oldest first.
#[derive(Default)]
pub(super) struct Strangers(Mutex<Waiting>);

#[derive(Default)]
struct Waiting {
    accepted: u64,
    places: Vec<Stranger>,
}

struct Stranger {
    number: u64,
    ip: IpAddr,
    stream: Arc<TcpStream>,
    sent_away: Arc<AtomicBool>,
}

/// The place of a stranger; dropping it frees the place.
pub(super) struct StrangerPlace {
    strangers: Arc<Strangers>,
    number: u64,
    sent_away: Arc<AtomicBool>,
}

impl Strangers {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a new connection. If `limit` places are taken, the oldest connection of the address that has most
    /// of them is sent away: whoever has the key sends it at once, and so is looked at before others fill the places.
    pub(super) fn admit(self: &Arc<Self>, stream: &Arc<TcpStream>, ip: IpAddr, limit: usize) -> StrangerPlace {
        let sent_away = Arc::new(AtomicBool::new(false));
        let mut waiting = self.waiting();
        if waiting.places.len() >= limit.max(1) {
            let taken_places = &waiting.places;
            let count_from = |ip| taken_places.iter().filter(|other| other.ip == ip).count();
            let largest = taken_places.iter().map(|stranger| count_from(stranger.ip)).max();
            let oldest_index = taken_places
                .iter()
                .position(|stranger| Some(count_from(stranger.ip)) == largest);
            let dismissed = waiting.places.remove(oldest_index.unwrap_or(0));
            dismissed.sent_away.store(true, Ordering::Release);
            // Ends the wait for the rest of its request.
            let _ = dismissed.stream.shutdown(Shutdown::Read);
        }
        let number = waiting.accepted;
        waiting.accepted += 1;
        waiting.places.push(Stranger {
            number,
            ip,
            stream: stream.clone(),
            sent_away: sent_away.clone(),
        });
        StrangerPlace {
            strangers: self.clone(),
            number,
            sent_away,
        }
    }
}

impl StrangerPlace {
    /// Whether the place was given to a newer connection.
    pub(super) fn is_sent_away(&self) -> bool {
        self.sent_away.load(Ordering::Acquire)
    }
}

impl Drop for StrangerPlace {
    fn drop(&mut self) {
        let mut waiting = self.strangers.waiting();
        waiting.places.retain(|stranger| stranger.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, TcpListener};

    use super::*;

    #[test]
    fn admit_drops_the_oldest_of_a_crowded_address() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
        let address = listener.local_addr().expect("an address");
        let test_stream = Arc::new(TcpStream::connect(address).expect("a connection"));
        let [crowded, calm_address] = [1, 2].map(|last| IpAddr::from([10, 0, 0, last]));
        let strangers = Arc::new(Strangers::default());
        let admit = |ip| strangers.admit(&test_stream, ip, 4);
        let calm_place = admit(calm_address);
        let flood_places: Vec<_> = (0..10).map(|_| admit(crowded)).collect();
        assert!(!calm_place.is_sent_away());
        let sent_away: Vec<_> = flood_places.iter().map(StrangerPlace::is_sent_away).collect();
        assert_eq!(sent_away, [[true; 7].as_slice(), &[false; 3]].concat());
        drop(flood_places);
        assert_eq!(strangers.waiting().places.len(), 1);
    }
}
