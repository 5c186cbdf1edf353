//! One browser: what it is told, and what it asks for.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket};
use futures_util::{
    SinkExt as _, StreamExt as _,
    stream::{SplitSink, SplitStream},
};
use serde::Deserialize;
use serde_json::json;
use tokio::{
    sync::{broadcast::error::RecvError, mpsc, watch},
    time::timeout,
};

use crate::{
    desk::{Client, Command, Rate},
    server::{Seat, Shared, welcome},
};

/// Longest message of a browser, bytes.
pub(crate) const LONGEST: usize = 1024;
/// How long a browser may take to show the token, and to take a message.
const PATIENCE: Duration = Duration::from_secs(10);
/// Views on their way to a browser that has not drawn those before.
const VIEWS: u64 = 2;
/// Answers that may wait for a browser.
const ANSWERS: usize = 16;

/// Why a socket is closed, as the page knows it.
const WRONG_TOKEN: u16 = 4401;
const TOO_MANY: u16 = 4429;
const ENDED: u16 = 4000;

/// What a browser sends first.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Hello {
    token: String,
}

/// Serves a browser until it leaves or the bench ends.
pub(crate) async fn talk(mut socket: WebSocket, shared: Arc<Shared>) {
    if !matches!(timeout(PATIENCE, knows_token(&mut socket, &shared)).await, Ok(true)) {
        close(&mut socket, WRONG_TOKEN, "the token is not that of this bench").await;
        return;
    }
    let Some(seat) = shared.come() else {
        close(&mut socket, TOO_MANY, "too many browsers look already").await;
        return;
    };
    let client = seat.client;
    // Whatever ends the task, the seat is given up.
    let _seated = Seated { client, shared: Arc::clone(&shared) };
    let (answer, answers) = mpsc::channel(ANSWERS);
    let (drawn, draws) = watch::channel(0);
    let (sink, stream) = socket.split();
    // Both at once: a browser that takes nothing is heard all the same.
    tokio::select! {
        () = listen(stream, client, &shared, answer, drawn) => {}
        _ = tell(sink, seat, &shared, answers, draws) => {}
    }
}

struct Seated {
    client: Client,
    shared: Arc<Shared>,
}

impl Drop for Seated {
    fn drop(&mut self) {
        self.shared.leave(self.client);
    }
}

async fn knows_token(socket: &mut WebSocket, shared: &Shared) -> bool {
    let Some(Ok(Message::Text(text))) = socket.recv().await else { return false };
    serde_json::from_str::<Hello>(&text).is_ok_and(|hello| shared.token.is(&hello.token))
}

async fn close(socket: &mut WebSocket, code: u16, reason: &'static str) {
    let frame = CloseFrame { code, reason: Utf8Bytes::from_static(reason) };
    // It may be gone.
    let _ = timeout(PATIENCE, socket.send(Message::Close(Some(frame)))).await;
}

/// Heeds what a browser asks for, until it leaves.
async fn listen(
    mut stream: SplitStream<WebSocket>,
    client: Client,
    shared: &Shared,
    answer: mpsc::Sender<Utf8Bytes>,
    drawn: watch::Sender<u64>,
) {
    let mut rate = Rate::new(Instant::now());
    while let Some(Ok(message)) = stream.next().await {
        let text = match message {
            Message::Text(text) => text,
            Message::Close(_) => return,
            _ => continue,
        };
        let answered = match serde_json::from_str::<Command>(&text) {
            Ok(Command::Seen) => {
                drawn.send_modify(|count| *count += 1);
                continue;
            }
            // STOP is never one too many.
            Ok(Command::Stop) => shared.command(client, &Command::Stop),
            _ if !rate.allows(Instant::now()) => Err("too many commands at once; wait a moment".to_owned()),
            Ok(command) => shared.command(client, &command),
            Err(error) => Err(format!("this is no command: {error}")),
        };
        let (done, words) = match answered {
            Ok(words) => (true, words),
            Err(words) => (false, words),
        };
        // A browser that takes nothing gets no answer.
        let _ = answer.try_send(json!({ "type": "answer", "done": done, "words": words }).to_string().into());
    }
}

/// Tells a browser what there is, until it takes nothing any more or the bench ends.
async fn tell(
    mut sink: SplitSink<WebSocket, Message>,
    seat: Seat,
    shared: &Shared,
    mut answers: mpsc::Receiver<Utf8Bytes>,
    mut drawn: watch::Receiver<u64>,
) -> Option<()> {
    let Seat { client, history, mut batches, mut state, mut views } = seat;
    send(&mut sink, Message::Text(welcome(shared, client).into())).await?;
    send(&mut sink, Message::Text(history.into())).await?;
    state.mark_changed();
    views.mark_changed();
    let mut sent = 0_u64;
    loop {
        let room = sent.saturating_sub(*drawn.borrow_and_update()) < VIEWS;
        tokio::select! {
            biased;
            Ok(()) = state.changed() => {
                let closed = shared.closed();
                if closed {
                    // What came before the end is told before it.
                    while let Ok(batch) = batches.try_recv() {
                        send(&mut sink, Message::Text(batch)).await?;
                    }
                }
                let text = state.borrow_and_update().clone();
                send(&mut sink, Message::Text(text)).await?;
                if closed {
                    let reason = Utf8Bytes::from_static("the bench has ended");
                    send(&mut sink, Message::Close(Some(CloseFrame { code: ENDED, reason }))).await?;
                    return Some(());
                }
            }
            Some(text) = answers.recv() => send(&mut sink, Message::Text(text)).await?,
            batch = batches.recv() => match batch {
                Ok(batch) => send(&mut sink, Message::Text(batch)).await?,
                Err(RecvError::Lagged(count)) => {
                    let text = json!({ "type": "lagged", "batches": count }).to_string();
                    send(&mut sink, Message::Text(text.into())).await?;
                }
                Err(RecvError::Closed) => return None,
            },
            Ok(()) = views.changed(), if room => {
                let message = views.borrow_and_update().clone();
                if let Some(message) = message {
                    sent += 1;
                    send(&mut sink, Message::Binary(message)).await?;
                }
            }
            Ok(()) = drawn.changed(), if !room => {}
        }
    }
}

/// `None` when the browser is gone, or takes nothing any more.
async fn send(sink: &mut SplitSink<WebSocket, Message>, message: Message) -> Option<()> {
    timeout(PATIENCE, sink.send(message)).await.ok()?.ok()
}
