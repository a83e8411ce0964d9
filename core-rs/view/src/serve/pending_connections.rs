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
    connections: Arc<PendingConnections>,
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
        let is_evicted = Arc::new(AtomicBool::new(false));
        let mut state = self.lock_state();
        if state.connections.len() >= limit.max(1) {
            let connections = &state.connections;
            let count_of_ip = |ip| connections.iter().filter(|other| other.ip == ip).count();
            let max_count = connections.iter().map(|connection| count_of_ip(connection.ip)).max();
            let oldest_index = connections
                .iter()
                .position(|stranger| Some(count_of_ip(stranger.ip)) == max_count);
            let evicted = state.connections.remove(oldest_index.unwrap_or(0));
            evicted.is_evicted.store(true, Ordering::Release);
            // Ends the wait for the rest of its request.
            let _ = evicted.stream.shutdown(Shutdown::Read);
        }
        let number = state.n_accepted;
        state.n_accepted += 1;
        state.connections.push(PendingConnection {
            number,
            ip,
            stream: stream.clone(),
            is_evicted: is_evicted.clone(),
        });
        PendingPlace {
            connections: self.clone(),
            number,
            is_evicted,
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
        let mut state = self.connections.lock_state();
        state.connections.retain(|connection| connection.number != self.number);
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
