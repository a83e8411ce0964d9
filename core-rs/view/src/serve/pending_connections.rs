//! Connections that have not given the key: they have a bounded number of places, and a new one always gets a place.

use std::net::{IpAddr, Shutdown, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The connections whose request was not accepted yet, the oldest first.
#[derive(Default)]
pub(super) struct PendingConnections(Mutex<PendingState>);

#[derive(Default)]
struct PendingState {
    n_accepted: u64,
    connections: Vec<PendingConnection>,
}

struct PendingConnection {
    number: u64,
    ip: IpAddr,
    stream: Arc<TcpStream>,
    is_evicted: Arc<AtomicBool>,
}

/// The place of a stranger; dropping it frees the place.
pub(super) struct PendingPlace {
    strangers: Arc<PendingConnections>,
    number: u64,
    is_evicted: Arc<AtomicBool>,
}

impl PendingConnections {
    fn lock_state(&self) -> MutexGuard<'_, PendingState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a new connection. If `limit` places are taken, the oldest connection of the address that has most
    /// of them is sent away: whoever has the key sends it at once, and so is looked at before others fill the places.
    pub(super) fn admit(self: &Arc<Self>, stream: &Arc<TcpStream>, ip: IpAddr, limit: usize) -> PendingPlace {
        let sent_away = Arc::new(AtomicBool::new(false));
        let mut waiting = self.lock_state();
        if waiting.connections.len() >= limit.max(1) {
            let taken_places = &waiting.connections;
            let count_from = |ip| taken_places.iter().filter(|other| other.ip == ip).count();
            let largest = taken_places.iter().map(|stranger| count_from(stranger.ip)).max();
            let oldest_index = taken_places
                .iter()
                .position(|stranger| Some(count_from(stranger.ip)) == largest);
            let dismissed = waiting.connections.remove(oldest_index.unwrap_or(0));
            dismissed.is_evicted.store(true, Ordering::Release);
            // Ends the wait for the rest of its request.
            let _ = dismissed.stream.shutdown(Shutdown::Read);
        }
        let number = waiting.n_accepted;
        waiting.n_accepted += 1;
        waiting.connections.push(PendingConnection {
            number,
            ip,
            stream: stream.clone(),
            is_evicted: sent_away.clone(),
        });
        PendingPlace {
            strangers: self.clone(),
            number,
            is_evicted: sent_away,
        }
    }
}

impl PendingPlace {
    /// Whether the place was given to a newer connection.
    pub(super) fn is_evicted(&self) -> bool {
        self.is_evicted.load(Ordering::Acquire)
    }
}

impl Drop for PendingPlace {
    fn drop(&mut self) {
        let mut waiting = self.strangers.lock_state();
        waiting.connections.retain(|stranger| stranger.number != self.number);
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
        let strangers = Arc::new(PendingConnections::default());
        let admit = |ip| strangers.admit(&test_stream, ip, 4);
        let calm_place = admit(calm_address);
        let flood_places: Vec<_> = (0..10).map(|_| admit(crowded)).collect();
        assert!(!calm_place.is_evicted());
        let sent_away: Vec<_> = flood_places.iter().map(PendingPlace::is_evicted).collect();
        assert_eq!(sent_away, [[true; 7].as_slice(), &[false; 3]].concat());
        drop(flood_places);
        assert_eq!(strangers.lock_state().connections.len(), 1);
    }
}
