//! The server with real sockets: what a page gets, which requests are refused, and what a thousand hostile requests
//! cost.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use ergon_view::serve::{AccessKey, ConnectionLimits, Retention, Server, ServerOptions};
use tungstenite::protocol::Role;
use tungstenite::{Message, WebSocket};

/// Counts the allocated bytes: current number, and the maximum since the last reset.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is handed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(held, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// The tests run one at a time, because one of them counts bytes.
static ALONE: Mutex<()> = Mutex::new(());

/// Timeout of a test; no test measures it.
const PATIENCE: Duration = Duration::from_secs(120);

fn alone() -> std::sync::MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A file of a given length, which is removed when dropped.
struct Lent(PathBuf);

impl Lent {
    fn new(name: &str, bytes: &[u8], length: u64) -> Self {
        let path = std::env::temp_dir().join(format!("ergon-{}-{name}", std::process::id()));
        let mut file = File::create(&path).expect("a file");
        file.write_all(bytes).expect("bytes");
        file.set_len(length).expect("a length");
        Self(path)
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

const KEY: &str = "00112233445566778899aabbccddeeff";

/// A server of a file to pages of this machine.
fn local(lent: &Lent) -> ServerOptions {
    ServerOptions::local(lent.0.clone(), AccessKey::new(KEY).expect("a key"))
}

fn connect(server: &Server) -> TcpStream {
    let stream = TcpStream::connect(("127.0.0.1", server.address().port())).expect("a connection");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    stream
}

/// The whole answer to some bytes.
fn say(server: &Server, bytes: &[u8]) -> String {
    let mut stream = connect(server);
    let _ = stream.write_all(bytes);
    let mut all = Vec::new();
    let _ = stream.read_to_end(&mut all);
    String::from_utf8_lossy(&all).into_owned()
}

/// The answer to a request with the key.
fn get(server: &Server, path: &str, more: &str) -> String {
    get_bare(server, &format!("/{KEY}{path}"), more)
}

fn get_bare(server: &Server, path: &str, more: &str) -> String {
    let position = server.address();
    let port = position.port();
    say(
        server,
        format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{more}\r\n").as_bytes(),
    )
}

fn status(answer: &str) -> &str {
    answer.split(' ').nth(1).unwrap_or("none")
}

fn body(answer: &str) -> &str {
    answer.split_once("\r\n\r\n").map_or("", |(_, body)| body)
}

const UPGRADE: &str = "Upgrade: websocket\r\nConnection: keep-alive, Upgrade\r\nSec-WebSocket-Version: 13\r\n\
    Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";

/// Opens the WebSocket of a page.
fn watch(server: &Server, path: &str) -> Option<WebSocket<TcpStream>> {
    let mut stream = connect(server);
    let port = server.address().port();
    let head = format!(
        "GET /{KEY}{path} HTTP/1.1\r\nHost: localhost:{port}\r\nOrigin: http://localhost:{port}\r\n{UPGRADE}\r\n"
    );
    stream.write_all(head.as_bytes()).expect("a head");
    let mut answer = Vec::new();
    while !answer.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        if stream.read(&mut byte).expect("an answer") == 0 {
            break;
        }
        answer.push(byte[0]);
    }
    let answer = String::from_utf8(answer).expect("text");
    // The answer of RFC 6455 to this key.
    let accepted = answer.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
    (status(&answer) == "101" && accepted).then(|| WebSocket::from_raw_socket(stream, Role::Client, None))
}

fn until(holds: impl Fn() -> bool, what: &str) {
    let end = std::time::Instant::now() + PATIENCE;
    while !holds() {
        assert!(std::time::Instant::now() < end, "{what}");
        thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn page_and_file_are_served_with_security_headers() {
    let _alone = alone();
    let bytes: Vec<u8> = (b'a'..=b'z').collect();
    let lent = Lent::new("served.motion", &bytes, 26);
    let server = Server::start(local(&lent)).expect("a server");
    let page = get(&server, "/?t=3", "");
    assert_eq!(status(&page), "200");
    for header in [
        "default-src 'self'",
        "frame-ancestors 'none'",
        "Cross-Origin-Resource-Policy: same-origin",
        "nosniff",
        "Content-Type: text/html",
    ] {
        assert!(page.contains(header), "{header}");
    }
    assert_eq!(body(&page), include_str!("../page/index.html"));
    assert_eq!(body(&get(&server, "/motion", "")).as_bytes(), bytes);
    let part = get(&server, "/motion", "Range: bytes=3-5\r\n");
    assert_eq!((status(&part), body(&part)), ("206", "def"));
    assert!(part.contains("Content-Range: bytes 3-5/26"));
    let rest = get(&server, "/motion", "Range: bytes=23-\r\n");
    assert_eq!(body(&rest), "xyz");
    let origin = format!("Origin: http://127.0.0.1:{}\r\n", server.address().port());
    assert_eq!(status(&get(&server, "/", &origin)), "200");
}

#[test]
fn motion_without_a_file_is_204() {
    let _alone = alone();
    let lent = Lent::new("gone.motion", b"abc", 3);
    let live = ServerOptions {
        motion_file: None,
        ..local(&lent)
    };
    let server = Server::start(live).expect("a server");
    let none = get(&server, "/motion", "");
    assert_eq!((status(&none), body(&none)), ("204", ""));
    assert!(none.contains("default-src 'self'"));
    // A file that existed at the start and is gone gives an error.
    let server = Server::start(local(&lent)).expect("a server");
    drop(lent);
    assert_eq!(status(&get(&server, "/motion", "")), "404");
}

#[test]
fn server_refuses_wrong_requests() {
    let _alone = alone();
    let lent = Lent::new("refused.motion", b"abc", 3);
    let server = Server::start(local(&lent)).expect("a server");
    let port = server.address().port();
    let complete = |text: &str| status(&say(&server, text.as_bytes())).to_owned();
    for (host, wanted) in [
        (format!("127.0.0.1:{port}"), "200"),
        (format!("localhost:{port}"), "200"),
        (format!("[::1]:{port}"), "200"),
        (format!("192.168.1.7:{port}"), "421"),
        (format!("rebound.example:{port}"), "421"),
        (format!("localhost.example:{port}"), "421"),
        ("127.0.0.1".into(), "421"),
        (format!("127.0.0.1:{}", port ^ 1), "421"),
    ] {
        let result = complete(&format!("GET /{KEY}/ HTTP/1.1\r\nHost: {host}\r\n\r\n"));
        assert_eq!(result, wanted, "{host}");
    }
    assert_eq!(complete("GET / HTTP/1.1\r\n\r\n"), "400");
    for (path, more, wanted) in [
        ("/", "Origin: http://elsewhere.example\r\n", "403"),
        ("/", "Origin: null\r\n", "403"),
        ("/../Cargo.toml", "", "404"),
        ("/%2e%2e/Cargo.toml", "", "404"),
        ("/live", "", "404"),
        ("/live", UPGRADE, "403"),
        ("/", "Content-Length: 5\r\n", "400"),
        ("/", "Transfer-Encoding: chunked\r\n", "400"),
        ("/", "Host: 127.0.0.1\r\n", "400"),
        ("/motion", "Range: bytes=3-\r\n", "416"),
        ("/motion", "Range: bytes=2-1\r\n", "416"),
        ("/motion", "Range: bytes=-1\r\n", "416"),
        ("/motion", "Range: bytes=0-1,2-3\r\n", "416"),
        ("/motion", "Range: bytes=99999999999999999999-\r\n", "416"),
    ] {
        assert_eq!(status(&get(&server, path, more)), wanted, "{path} {more}");
    }
    let post = format!("POST /{KEY}/ HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n");
    assert_eq!(complete(&post), "405");
    let origin = format!("Origin: http://127.0.0.1:{port}\r\n");
    for wrong in [
        UPGRADE.replace("13", "8"),
        UPGRADE.replace("==", ""),
        UPGRADE.replace("websocket", "h2c"),
        UPGRADE.replace(", Upgrade", ""),
    ] {
        let result = get(&server, "/live", &format!("{origin}{wrong}"));
        assert_eq!(status(&result), "400", "{wrong}");
    }
    let long = format!("X: {}\r\n", "y".repeat(9000));
    assert_eq!(status(&get(&server, "/", &long)), "431");
    assert_eq!(status(&get(&server, "/", &"X: y\r\n".repeat(65))), "431");
}

#[test]
fn key_is_required_in_the_address() {
    let _alone = alone();
    let lent = Lent::new("key.motion", b"abc", 3);
    assert_eq!(AccessKey::new("0123"), None);
    assert_eq!(AccessKey::new(&"g".repeat(32)), None);
    for ip in [Ipv4Addr::LOCALHOST, Ipv4Addr::UNSPECIFIED] {
        let position = SocketAddr::new(ip.into(), 0);
        let server = Server::start(ServerOptions {
            address: position,
            ..local(&lent)
        })
        .expect("a server");
        assert!(server.url().ends_with(&format!("/{KEY}/")));
        assert_eq!(status(&get(&server, "/", "")), "200");
        assert_eq!(body(&get(&server, "/motion", "")), "abc");
        let port = server.address().port();
        let origin = format!("Origin: http://127.0.0.1:{port}\r\n{UPGRADE}");
        for (path, more) in [
            ("/", ""),
            ("/motion", ""),
            ("/sound.wav", ""),
            ("/main.js", ""),
            ("/live", &*origin),
            ("/00112233445566778899aabbccddeefe/", ""),
            ("/00112233445566778899aabbccddeeff", ""),
            ("//", ""),
        ] {
            assert_eq!(status(&get_bare(&server, path, more)), "404", "{path}");
        }
        assert!(watch(&server, "/live").is_some());
        // In a network any address of the machine is accepted, but no name in another's domain.
        let named = |host: &str| format!("GET /{KEY}/ HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n");
        let result = say(&server, named("192.168.1.7").as_bytes());
        assert_eq!(status(&result), if ip.is_loopback() { "421" } else { "200" });
        assert_eq!(status(&say(&server, named("a.example").as_bytes())), "421");
    }
}

#[test]
fn repeated_connections_do_not_exclude_a_page() {
    let _alone = alone();
    let lent = Lent::new("strangers.motion", b"abc", 3);
    let server = Server::start(local(&lent)).expect("a server");
    let mut page = watch(&server, "/live").expect("a page");
    let mut crowd = Vec::new();
    for _ in 0..20 {
        // Each connection of the crowd is opened anew: silent, or with half a head, or with a whole one without the
        // key whose answer nobody reads.
        crowd = (0..96)
            .map(|i| {
                let mut stream = connect(&server);
                let head = ["", "GET / HTTP/1.1\r\nHost: ", "GET / HTTP/1.1\r\nHost: x\r\n\r\n"];
                let _ = stream.write_all(head[i % 3].as_bytes());
                stream
            })
            .collect();
        assert_eq!(status(&get(&server, "/motion", "")), "200");
        page.send(Message::text("ping 0")).expect("a ping");
        page.read().expect("a pong");
    }
    drop(crowd);
}

#[test]
fn full_server_refuses_a_page_with_a_reason() {
    let _alone = alone();
    let lent = Lent::new("full.motion", b"", 64 << 20);
    let mut options = local(&lent);
    options.limits.connections = 3;
    options.limits.pending_connections = 2;
    let server = Server::start(options).expect("a server");
    // Pages that ask for much and take nothing have all places, until they are dropped.
    let port = server.address().port();
    let ask = format!("GET /{KEY}/motion HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n");
    let slow: Vec<_> = (0..3)
        .map(|_| {
            let mut stream = connect(&server);
            stream.write_all(ask.as_bytes()).expect("a head");
            let mut byte = [0];
            stream.read_exact(&mut byte).expect("an answer");
            stream
        })
        .collect();
    assert_eq!(status(&get(&server, "/", "")), "503");
    drop(slow);
    until(|| status(&get(&server, "/", "")) == "200", "places again");
    // The oldest stranger is told too, though its request is not whole.
    let mut halves: Vec<_> = (0..3).map(|_| connect(&server)).collect();
    for stream in &mut halves {
        stream.write_all(b"GET / HTT").expect("half a head");
    }
    let mut all = String::new();
    let ended = halves[0].read_to_string(&mut all);
    assert_eq!((ended.is_ok(), status(&all)), (true, "503"));
}

#[test]
fn seventeenth_page_is_refused() {
    let _alone = alone();
    let lent = Lent::new("many.motion", b"", 0);
    let server = Server::start(local(&lent)).expect("a server");
    server.hub().set_greeting(b"manifest");
    let mut pages: Vec<_> = (0..16).map(|_| watch(&server, "/live").expect("a page")).collect();
    let tally = server.counts();
    until(|| tally.viewers.load(Ordering::Relaxed) == 16, "sixteen");
    assert!(watch(&server, "/live").is_none());
    for page in &mut pages {
        assert_eq!(page.read().expect("a greeting"), Message::binary(&b"manifest"[..]));
        page.send(Message::text("ping 12.5")).expect("a ping");
        let pong = page.read().expect("a pong").into_text().expect("text");
        let words: Vec<_> = pong.split(' ').collect();
        assert_eq!(words[..2], ["pong", "12.5"]);
        let position: f64 = words[2].parse().expect("a time");
        assert!((0.0..=server.now()).contains(&position));
    }
    // The first page does not read: it delays neither the other pages nor `publish`.
    for i in 0..1000u32 {
        server.hub().publish(&i.to_le_bytes(), Retention::All);
        for page in &mut pages[1..] {
            let bytes = page.read().expect("an event").into_data();
            assert_eq!(bytes[..], i.to_le_bytes());
        }
    }
    drop(pages);
    until(|| tally.viewers.load(Ordering::Relaxed) == 0, "all gone");
    assert!(watch(&server, "/live").is_some());
}

#[test]
fn stalled_page_is_dropped() {
    let _alone = alone();
    let lent = Lent::new("stall.motion", b"", 0);
    let mut options = local(&lent);
    options.limits.stall_timeout = Duration::from_millis(100);
    let server = Server::start(options).expect("a server");
    let _page = watch(&server, "/live").expect("a page");
    let tally = server.counts();
    until(|| tally.viewers.load(Ordering::Relaxed) == 1, "a viewer");
    let frame = vec![0; 1 << 20];
    until(
        || {
            server.hub().publish(&frame, Retention::All);
            tally.viewers.load(Ordering::Relaxed) == 0
        },
        "nobody",
    );
    assert_eq!(tally.dropped.load(Ordering::Relaxed), 1);
    assert!(server.hub().stored_bytes() <= 16 << 20);
}

/// One kind of hostile request, chosen by `i`.
fn hostile(server: &Server, i: u64) {
    let port = server.address().port();
    let host = format!("Host: 127.0.0.1:{port}\r\n");
    let origin = format!("Origin: http://127.0.0.1:{port}\r\n");
    let upgrade = format!("GET /{KEY}/live HTTP/1.1\r\n{host}{origin}{UPGRADE}\r\n");
    // SplitMix64, so that every request differs.
    let mut seed = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut random = move || {
        seed = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (seed ^ (seed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB)
    };
    let mut then = Vec::new();
    let head = match i % 10 {
        0 => format!("GET /{KEY}/ HTTP/1.1\r\nHost: {i}.example:{port}\r\n\r\n"),
        1 => {
            format!("GET /{KEY}/live HTTP/1.1\r\n{host}Origin: http://{i}.example\r\n{UPGRADE}\r\n")
        }
        2 => format!(
            "GET /{KEY}/live HTTP/1.1\r\n{host}{origin}{}\r\n",
            UPGRADE.replace("13", "99")
        ),
        3 => {
            then.extend((0..2000).map(|_| random() as u8));
            String::new()
        }
        4 => format!("GET /{KEY}/ HTTP/1.1\r\n{host}X: {}", "y".repeat(200_000)),
        // Half of a head, and then nothing.
        5 => format!("GET /{KEY}/ HTTP/1.1\r\n{host}X-"),
        // A frame whose declared length is 2⁶² bytes.
        6 => {
            then.extend([0x82, 0xff, 0x40, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5]);
            upgrade
        }
        // Frames of random bytes; the first is one that no page sends.
        7 => {
            then.push(0x70 | random() as u8 & 0x0f);
            then.extend((0..500).map(|_| random() as u8));
            upgrade
        }
        // A text that is not a valid message, masked with zeros.
        8 => {
            then.extend([0x81, 0x84, 0, 0, 0, 0]);
            then.extend(b"play");
            upgrade
        }
        // A reader that requests everything and takes nothing.
        _ => format!("GET /{KEY}/motion HTTP/1.1\r\n{host}\r\n"),
    };
    let mut stream = connect(server);
    let _ = stream.write_all(head.as_bytes());
    let _ = stream.write_all(&then);
    if i % 10 == 9 {
        stream.set_write_timeout(Some(PATIENCE)).expect("a timeout");
        // Writing fails once the server has closed the connection.
        while stream.write_all(b"x").is_ok() {
            thread::sleep(Duration::from_millis(10));
        }
    } else {
        let mut all = Vec::new();
        if let Err(error) = stream.read_to_end(&mut all) {
            assert_ne!(error.kind(), ErrorKind::WouldBlock, "request {i} was never ended");
        }
        let text = String::from_utf8_lossy(&all);
        assert_ne!(status(&text), "200", "request {i}");
    }
}

#[test]
fn hostile_requests_are_refused_beside_a_page() {
    const N: u64 = 1000;
    let _alone = alone();
    let lent = Lent::new("hostile.motion", b"", 64 << 20);
    let mut options = local(&lent);
    options.limits = ConnectionLimits {
        head_timeout: Duration::from_millis(300),
        stall_timeout: Duration::from_millis(300),
        ..ConnectionLimits::default()
    };
    let server = Server::start(options).expect("a server");
    let mut page = watch(&server, "/live").expect("a page");
    // An answer to `ping` shows that the page has joined.
    page.send(Message::text("ping 0")).expect("a ping");
    page.read().expect("a pong");
    PEAK.store(HELD.load(Ordering::Relaxed), Ordering::Relaxed);
    let before = HELD.load(Ordering::Relaxed);
    let next = AtomicU64::new(0);
    thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= N {
                        return;
                    }
                    hostile(&server, i);
                    server.hub().publish(&i.to_le_bytes(), Retention::All);
                }
            });
        }
        // Every event arrives, even while hostile clients hold connections.
        let mut seen = vec![0; N as usize];
        for _ in 0..N {
            let bytes = page.read().expect("an event").into_data();
            seen[u64::from_le_bytes(bytes[..].try_into().expect("eight")) as usize] += 1;
        }
        assert!(seen.iter().all(|n| *n == 1));
    });
    let tally = server.counts();
    let ended = || tally.refused.load(Ordering::Relaxed) + tally.dropped.load(Ordering::Relaxed) >= N;
    until(ended, "all refused");
    let peak = PEAK.load(Ordering::Relaxed) - before;
    assert!(peak < 8 << 20, "{peak} bytes");
    until(|| tally.viewers.load(Ordering::Relaxed) == 1, "strangers gone");
    assert_eq!(status(&get(&server, "/", "")), "200");
}

#[test]
fn dropped_server_closes_its_pages() {
    let _alone = alone();
    let lent = Lent::new("over.motion", b"", 0);
    let server = Server::start(local(&lent)).expect("a server");
    let mut page = watch(&server, "/live").expect("a page");
    let position = server.address();
    drop(server);
    assert!(matches!(page.read(), Ok(Message::Close(_))));
    // The port is free again.
    let options = ServerOptions {
        address: position,
        ..local(&lent)
    };
    drop(Server::start(options).expect("the same port"));
}
