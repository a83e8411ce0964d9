//! Keys that pages play: what a page may send, and what a page that lies moves.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ergon_view::serve::{AccessKey, ConnectionLimits, KeyPoints, PageKey, Server, ServerOptions};
use tungstenite::protocol::Role;
use tungstenite::{Message, WebSocket};

const KEY: &str = "00112233445566778899aabbccddeeff";
const PATIENCE: Duration = Duration::from_secs(300);

/// A key that notes what reaches it; as a lead does, it refuses what is not finite.
#[derive(Debug, Default)]
struct Noted {
    is_held: AtomicBool,
    places: Mutex<Vec<(f64, f64, Option<f64>)>>,
    refused: Mutex<usize>,
}

impl PageKey for Noted {
    fn name(&self) -> &str {
        "ada \"the first\""
    }

    fn input(&self) -> &str {
        "keys"
    }

    fn range(&self) -> [f64; 2] {
        [-0.05, 0.05]
    }

    fn acquire(&self) -> bool {
        !self.is_held.swap(true, Ordering::AcqRel)
    }

    fn is_held(&self) -> bool {
        self.is_held.load(Ordering::Acquire)
    }

    fn release(&self) {
        self.is_held.store(false, Ordering::Release);
    }

    fn add_position(&self, age: f64, x: f64, pressure: Option<f64>) -> bool {
        let is_finite = age.is_finite() && x.is_finite();
        if is_finite {
            self.places.lock().unwrap().push((age, x, pressure));
        } else {
            self.count_refused();
        }
        is_finite
    }

    fn count_refused(&self) {
        *self.refused.lock().unwrap() += 1;
    }

    fn points(&self) -> KeyPoints {
        KeyPoints {
            pointer: 0.5,
            finger: 0.25,
            key: 0.125,
            force: -2.0,
        }
    }
}

impl Noted {
    fn refusals(&self) -> usize {
        *self.refused.lock().unwrap()
    }

    fn n_places(&self) -> usize {
        self.places.lock().unwrap().len()
    }
}

fn served(keys: &[Arc<Noted>]) -> Server {
    let keys = keys.iter().map(|key| key.clone() as Arc<dyn PageKey>);
    Server::start(ServerOptions {
        address: "127.0.0.1:0".parse().unwrap(),
        access_key: AccessKey::new(KEY).unwrap(),
        motion_file: None,
        sound_file: None,
        page_keys: keys.collect(),
        limits: ConnectionLimits::default(),
    })
    .expect("a server")
}

/// The answer to a request; its first line says the status.
fn answer(server: &Server, path: &str, more: &str) -> (String, TcpStream) {
    let mut stream = TcpStream::connect(server.address()).expect("a connection");
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let port = server.address().port();
    let head = format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{more}\r\n");
    stream.write_all(head.as_bytes()).unwrap();
    let mut bytes = Vec::new();
    while !bytes.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        if stream.read(&mut byte).unwrap() == 0 {
            break;
        }
        bytes.push(byte[0]);
    }
    (String::from_utf8(bytes).unwrap(), stream)
}

fn upgrade(origin: &str) -> String {
    format!(
        "Origin: {origin}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    )
}

fn join(server: &Server) -> WebSocket<TcpStream> {
    let origin = format!("http://127.0.0.1:{}", server.address().port());
    let (head, stream) = answer(server, &format!("/{KEY}/hands"), &upgrade(&origin));
    assert!(head.starts_with("HTTP/1.1 101"), "{head}");
    WebSocket::from_raw_socket(stream, Role::Client, None)
}

fn positions(key: u8, kind: u8, rows: &[(f64, f32, f32)]) -> Message {
    let mut bytes = vec![key, kind];
    bytes.extend((rows.len() as u16).to_le_bytes());
    for &(time, x, pressure) in rows {
        bytes.extend(time.to_le_bytes());
        bytes.extend(x.to_le_bytes());
        bytes.extend(pressure.to_le_bytes());
    }
    Message::binary(bytes)
}

fn until(what: &str, holds: impl Fn() -> bool) {
    let begin = Instant::now();
    while !holds() {
        assert!(begin.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The next text from the server.
fn text(page: &mut WebSocket<TcpStream>) -> String {
    loop {
        if let Message::Text(text) = page.read().expect("a message") {
            return text.to_string();
        }
    }
}

#[test]
fn page_moves_a_key_until_it_closes() {
    let key = Arc::new(Noted::default());
    let server = served(std::slice::from_ref(&key));
    let mut page = join(&server);
    page.send(Message::text("hold 0")).unwrap();
    let now = server.now();
    page.send(positions(0, 0, &[(now, 0.25, 0.5), (now, -0.5, 1.0)]))
        .unwrap();
    page.send(positions(0, 1, &[(now, -0.5, 0.0)])).unwrap();
    until("three places", || key.n_places() == 3);
    let places = key.places.lock().unwrap().clone();
    let rows: Vec<_> = places.iter().map(|&(_, x, pressure)| (x, pressure)).collect();
    assert_eq!(rows, [(0.25, Some(0.5)), (-0.5, Some(1.0)), (-0.5, None)]);
    assert!(places.iter().all(|place| place.0 >= 0.0), "{places:?}");
    let picture = loop {
        if let Message::Binary(picture) = page.read().unwrap() {
            break picture;
        }
    };
    assert_eq!(picture.len(), 17);
    assert_eq!(picture[13..17], (-2.0_f32).to_le_bytes());
    drop(page);
    until("the key is left", || !key.is_held());
}

#[test]
fn page_is_refused_a_key_of_another_page() {
    let key = Arc::new(Noted::default());
    let server = served(std::slice::from_ref(&key));
    let (mut first, mut second) = (join(&server), join(&server));
    first.send(Message::text("hold 0")).unwrap();
    until("held", || key.is_held());
    second.send(Message::text("hold 0")).unwrap();
    assert_eq!(text(&mut second), "taken 0");
    second.send(positions(0, 0, &[(0.0, 0.1, 0.5); 3])).unwrap();
    until("refusals", || key.refusals() == 3);
    assert_eq!(key.n_places(), 0);
    second.send(Message::text("leave 0")).unwrap();
    drop(second);
    first.send(positions(0, 0, &[(server.now(), 0.1, 0.5)])).unwrap();
    until("the first page plays on", || key.n_places() == 1);
}

#[test]
fn page_with_non_finite_positions_is_ignored() {
    let key = Arc::new(Noted::default());
    let server = served(std::slice::from_ref(&key));
    let mut page = join(&server);
    page.send(Message::text("hold 0")).unwrap();
    page.send(positions(0, 0, &[(0.0, f32::NAN, 0.5), (f64::NAN, 0.0, 0.5)]))
        .unwrap();
    until("refusals", || key.refusals() == 2);
    assert_eq!(key.n_places(), 0);
}

#[test]
fn page_with_floods_or_nonsense_is_disconnected() {
    let dropped = |server: &Server| server.counts().dropped.load(Ordering::Relaxed);
    let key = Arc::new(Noted::default());
    let server = served(std::slice::from_ref(&key));
    let sound = positions(0, 0, &[(0.0, 0.0, 0.5); 64]);
    let mut strangers = vec![
        vec![Message::text("hold 7")],
        vec![Message::text("jump 0")],
        vec![Message::text("nonsense")],
        vec![Message::binary(vec![0; 3])],
        vec![positions(9, 0, &[(0.0, 0.0, 0.5)])],
        vec![positions(0, 0, &[(0.0, 0.0, 0.5); 65])],
    ];
    strangers.push(vec![sound; 200]); // of a key that this page does not hold
    for (n, messages) in strangers.into_iter().enumerate() {
        let mut page = join(&server);
        for message in messages {
            // The server may have closed the connection already.
            let _ = page.send(message);
        }
        until(&format!("the end of stranger {n}"), || dropped(&server) == n as u64 + 1);
    }
    assert_eq!(key.n_places(), 0);
}

#[test]
fn page_with_wrong_origin_or_token_is_refused() {
    let server = served(&[Arc::new(Noted::default())]);
    let origin = format!("http://127.0.0.1:{}", server.address().port());
    let status = |path: &str, origin: &str| answer(&server, path, &upgrade(origin)).0;
    let right = format!("/{KEY}/hands");
    assert!(status(&right, &origin).starts_with("HTTP/1.1 101"));
    assert!(status(&right, "http://elsewhere.example").starts_with("HTTP/1.1 403"));
    let wrong = format!("/{}/hands", "0".repeat(32));
    assert!(status(&wrong, &origin).starts_with("HTTP/1.1 404"));
    let without = served(&[]);
    let origin = format!("http://127.0.0.1:{}", without.address().port());
    assert!(
        answer(&without, &right, &upgrade(&origin))
            .0
            .starts_with("HTTP/1.1 404")
    );
}

#[test]
fn page_lists_keys() {
    let server = served(&[Arc::new(Noted::default())]);
    let (_, mut stream) = answer(&server, &format!("/{KEY}/hands"), "");
    let mut body = String::new();
    stream.read_to_string(&mut body).unwrap();
    assert_eq!(
        body,
        r#"[{"name": "ada \"the first\"", "input": "keys", "low": -0.05, "high": 0.05}]"#
    );
}
