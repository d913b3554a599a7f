//! One connection: the handshake, requests in, messages out.

use std::io;
use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use tungstenite::handshake::HandshakeError;
use tungstenite::handshake::server::{ErrorResponse, Request as HttpRequest, Response};
use tungstenite::http::{HeaderValue, StatusCode};
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, Message, WebSocket, accept_hdr_with_config};

use crate::protocol::{self, Request};
use crate::shared::{Mailbox, Shared, lock};

/// Time for the whole handshake.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// Longest wait for a request before messages are looked for.
const READ: Duration = Duration::from_millis(10);
/// Longest wait for a client to take bytes before the end of the program is looked for.
const WRITE: Duration = Duration::from_millis(200);
/// Time in which a client takes no byte before the connection is given up.
const STUCK: Duration = Duration::from_secs(20);
/// Largest request \[bytes\].
const LARGEST_REQUEST: usize = 1 << 20;
/// Messages that are written between two looks at requests: 12 800 a second and more.
const BATCH: usize = 128;
/// Warnings that answer one request.
const MAX_WARNINGS: usize = 16;

type Socket = WebSocket<TcpStream>;

/// Serves a client until it leaves, or the program ends. `first`: what every client gets first.
pub(crate) fn serve(stream: TcpStream, shared: &Shared, first: &[String]) {
    let Some(mut socket) = shake_hands(stream, shared) else {
        shared.refused.fetch_add(1, Ordering::Relaxed);
        return;
    };
    shared.ever.fetch_add(1, Ordering::Relaxed);
    shared.connected.fetch_add(1, Ordering::Relaxed);
    let mailbox = Arc::new(Mutex::new(Mailbox::default()));
    shared.join(&mailbox);
    // A client that is gone is no fault of this program's.
    let _ = converse(&mut socket, shared, &mailbox, first);
    shared.leave(&mailbox);
    shared.connected.fetch_sub(1, Ordering::Relaxed);
}

fn shake_hands(stream: TcpStream, shared: &Shared) -> Option<Socket> {
    stream.set_nonblocking(false).ok()?;
    stream.set_nodelay(true).ok()?;
    stream.set_read_timeout(Some(READ)).ok()?;
    stream.set_write_timeout(Some(WRITE)).ok()?;
    let config =
        WebSocketConfig::default().max_message_size(Some(LARGEST_REQUEST)).max_frame_size(Some(LARGEST_REQUEST));
    let begin = Instant::now();
    let mut step = accept_hdr_with_config(stream, choose, Some(config));
    loop {
        let has_time = begin.elapsed() < HANDSHAKE && !shared.stop.load(Ordering::Relaxed);
        match step {
            Ok(socket) => return Some(socket),
            // A part of it has come.
            Err(HandshakeError::Interrupted(part)) if has_time => step = part.handshake(),
            Err(_) => return None,
        }
    }
}

#[allow(clippy::result_large_err, reason = "the type of the library's callback")]
fn choose(request: &HttpRequest, mut response: Response) -> Result<Response, ErrorResponse> {
    const HEADER: &str = "sec-websocket-protocol";
    let offers: Vec<&str> = request.headers().get_all(HEADER).iter().filter_map(|value| value.to_str().ok()).collect();
    let Some(name) = protocol::negotiate(&offers) else {
        let text = format!("this server speaks {}", protocol::SUBPROTOCOLS.join(" and "));
        let mut refusal = ErrorResponse::new(Some(text));
        *refusal.status_mut() = StatusCode::BAD_REQUEST;
        return Err(refusal);
    };
    response.headers_mut().insert(HEADER, HeaderValue::from_static(name));
    Ok(response)
}

/// Whether an operation has only to be done again.
fn is_again(why: &Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(why, Error::Io(why) if [Interrupted, TimedOut, WouldBlock].contains(&why.kind()))
}

/// Hands a message to the socket's buffer. Bytes that the client does not take now stay there; returns whether all were taken.
fn put(socket: &mut Socket, message: Message) -> Result<bool, Error> {
    match socket.write(message) {
        Ok(()) => Ok(true),
        Err(why) if is_again(&why) => Ok(false),
        Err(why) => Err(why),
    }
}

fn converse(socket: &mut Socket, shared: &Shared, mailbox: &Mutex<Mailbox>, first: &[String]) -> Result<(), Error> {
    for text in first {
        put(socket, Message::text(text.clone()))?;
    }
    // Since when the client takes nothing.
    let mut stuck: Option<Instant> = None;
    loop {
        match socket.flush() {
            Ok(()) => stuck = None,
            Err(why) if is_again(&why) => {
                if stuck.get_or_insert_with(Instant::now).elapsed() > STUCK {
                    return Ok(());
                }
            }
            Err(why) => return Err(why),
        }
        if shared.stop.load(Ordering::Relaxed) {
            // Whether it arrives or not, the connection ends.
            let _ = socket.close(None);
            let _ = socket.flush();
            return Ok(());
        }
        if stuck.is_some() {
            continue;
        }
        send_waiting(socket, shared, mailbox)?;
        socket.flush().or_else(|why| if is_again(&why) { Ok(()) } else { Err(why) })?;
        let answers = match socket.read() {
            Ok(Message::Text(text)) => match Request::parse(&text) {
                Ok(Request::Subscribe(wanted)) => shared.subscribe(mailbox, &wanted),
                Ok(Request::Unsubscribe(ids)) => Shared::unsubscribe(mailbox, &ids),
                Err(answer) => vec![answer],
            },
            Ok(Message::Binary(_)) => vec!["messages of clients are refused; rivet view only sends".to_owned()],
            // Pings are answered by the library.
            Ok(_) => Vec::new(),
            Err(why) if is_again(&why) => Vec::new(),
            Err(why) => return Err(why),
        };
        let more = answers.len().saturating_sub(MAX_WARNINGS);
        let more = (more > 0).then(|| format!("{more} more of this request cannot be done"));
        for answer in answers.into_iter().take(MAX_WARNINGS).chain(more) {
            // What a client does not take delays neither the end of the program nor its other messages.
            if !put(socket, Message::text(protocol::warning(&answer)))? {
                break;
            }
        }
    }
}

/// Writes some of the messages that wait, as long as the client takes them.
fn send_waiting(socket: &mut Socket, shared: &Shared, mailbox: &Mutex<Mailbox>) -> Result<(), Error> {
    for _ in 0..BATCH {
        let Some(outgoing) = lock(mailbox).pop() else { break };
        let data = protocol::message_data(outgoing.id, outgoing.log_time_ns, &outgoing.payload);
        let is_taken = put(socket, Message::binary(data))?;
        shared.tallies[outgoing.channel].sent.fetch_add(1, Ordering::Relaxed);
        if !is_taken {
            break;
        }
    }
    Ok(())
}
