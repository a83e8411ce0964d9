//! The open clients of this process; all are of one server.
//!
//! When a client is opened after the server of another has ended, libjack frees every client of the process
//! (`JackLibGlobals::Init`), and those who still have one are not informed. So every client is closed here first,
//! and nobody reaches a client that is closed.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What the registry asks of a client.
pub(super) trait Connection {
    /// Whether its server has ended.
    fn has_server_ended(&self) -> bool;
    /// Ends it; afterwards its server counts as ended.
    fn close(&self);
}

/// The open clients; one lock for all calls that open, use or close one, except those from a process callback.
pub(super) struct Registry<C>(Mutex<Vec<Arc<C>>>);

impl<C: Connection> Registry<C> {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Opens a further client; closes all others before, if the server of one has ended.
    pub(super) fn open<E>(&self, open: impl FnOnce() -> Result<C, E>) -> Result<Arc<C>, E> {
        let mut clients = self.lock();
        if clients.iter().any(|client| client.has_server_ended()) {
            clients.drain(..).for_each(|client| client.close());
        }
        let client = Arc::new(open()?);
        clients.push(client.clone());
        Ok(client)
    }

    /// Calls `call` while nobody else opens or closes a client; nothing if this one is closed.
    pub(super) fn call<T>(&self, client: &Arc<C>, call: impl FnOnce() -> T) -> Option<T> {
        let clients = self.lock();
        clients.iter().any(|other| Arc::ptr_eq(other, client)).then(call)
    }

    /// Closes a client unless it is closed already.
    pub(super) fn close(&self, client: &Arc<C>) {
        let mut clients = self.lock();
        if let Some(client_index) = clients.iter().position(|other| Arc::ptr_eq(other, client)) {
            clients.swap_remove(client_index).close();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Arc<C>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

    use super::*;

    #[derive(Default)]
    struct Counted {
        gone: AtomicBool,
        n_closed: AtomicU32,
    }

    impl Connection for Counted {
        fn has_server_ended(&self) -> bool {
            self.gone.load(Ordering::Relaxed)
        }

        fn close(&self) {
            self.gone.store(true, Ordering::Relaxed);
            self.n_closed.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn open(registry: &Registry<Counted>) -> Arc<Counted> {
        registry.open(|| Ok::<_, ()>(Counted::default())).unwrap()
    }

    #[test]
    fn open_after_a_server_has_ended_closes_every_client_once() {
        let registry = Registry::new();
        let (lost_client, other_client) = (open(&registry), open(&registry));
        lost_client.gone.store(true, Ordering::Relaxed);
        let new_client = open(&registry);
        for client in [&lost_client, &other_client] {
            assert!(client.has_server_ended());
            assert_eq!(registry.call(client, || 1), None);
            registry.close(client);
            assert_eq!(client.n_closed.load(Ordering::Relaxed), 1);
        }
        assert_eq!(registry.call(&new_client, || 1), Some(1));
    }

    #[test]
    fn open_beside_a_running_server_closes_nothing() {
        let registry = Registry::new();
        let (first_client, second_client) = (open(&registry), open(&registry));
        assert_eq!(registry.call(&first_client, || 1), Some(1));
        registry.close(&first_client);
        assert_eq!(registry.call(&first_client, || 1), None);
        assert_eq!(registry.call(&second_client, || 1), Some(1));
    }

    #[test]
    fn open_with_an_error_registers_nothing() {
        let registry = Registry::<Counted>::new();
        assert_eq!(registry.open(|| Err("no server")).err(), Some("no server"));
        assert!(registry.lock().is_empty());
    }
}
