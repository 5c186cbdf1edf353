//! The server: an ordinary thread with a runtime of its own, never the loop's.

use std::{
    collections::VecDeque,
    net::{IpAddr, SocketAddr, TcpListener},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use axum::{
    Router,
    body::{Body, Bytes},
    extract::{Request, State, WebSocketUpgrade, ws::Utf8Bytes},
    http::{HeaderMap, HeaderValue, Response, StatusCode, header},
    middleware::{self, Next},
    response::IntoResponse,
    routing::{MethodRouter, any, get},
};
use bench_recording::Record;
use bench_rig::Calibration;
use rtrb::Consumer;
use serde_json::json;
use tokio::sync::{broadcast, mpsc, watch};

use crate::{
    About, Controls, Frames, Outcome, Stage, Start, ViewError, controls,
    desk::{Answer, Client, Command, Desk, Pressed},
    socket,
    telemetry::Telemetry,
    token::Token,
};

/// Between two batches.
const BATCH: Duration = Duration::from_millis(33);
/// Batches that may wait for a browser, four seconds of them; then it misses some.
const BATCHES: usize = 128;
/// Bytes of batches that are kept for browsers that come late.
const HISTORY: usize = 6_000_000;
/// Records that are taken at a time, so that browsers get their turn.
const AT_A_TIME: usize = 20_000;
/// How long browsers may take to hear that the bench ends.
const GOODBYE: Duration = Duration::from_secs(2);
/// Bytes on their way to a browser, about one set of views.
const SEND_BUFFER: usize = 256 * 1024;
/// Browsers at once.
const BROWSERS: usize = 16;

/// What the server's tasks and the command share.
pub(crate) struct Shared {
    /// Browsers that look.
    pub looking: AtomicUsize,
    /// The newest views.
    pub views: watch::Sender<Option<Bytes>>,
    /// What every page shows of the desk, as JSON.
    pub state: watch::Sender<Utf8Bytes>,
    pub token: Token,
    /// What is told once, as JSON.
    pub about: serde_json::Value,
    port: u16,
    inner: Mutex<Inner>,
}

struct Inner {
    desk: Desk,
    batches: broadcast::Sender<Utf8Bytes>,
    history: VecDeque<Utf8Bytes>,
    history_bytes: usize,
    closing: Option<Outcome>,
}

/// What a browser gets when it was let in.
pub(crate) struct Seat {
    pub client: Client,
    pub history: String,
    pub batches: broadcast::Receiver<Utf8Bytes>,
    pub state: watch::Receiver<Utf8Bytes>,
    pub views: watch::Receiver<Option<Bytes>>,
}

impl Shared {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets somebody with the token in; `None` when there are too many.
    pub(crate) fn come(&self) -> Option<Seat> {
        let mut inner = self.inner();
        if inner.desk.clients() >= BROWSERS {
            return None;
        }
        let client = inner.desk.come();
        let history: Vec<&str> = inner.history.iter().map(Utf8Bytes::as_str).collect();
        let history = format!("{{\"type\":\"history\",\"batches\":[{}]}}", history.join(","));
        self.looking.store(inner.desk.clients(), Ordering::Relaxed);
        self.tell(&inner);
        Some(Seat {
            client,
            history,
            batches: inner.batches.subscribe(),
            state: self.state.subscribe(),
            views: self.views.subscribe(),
        })
    }

    pub(crate) fn leave(&self, client: Client) {
        let mut inner = self.inner();
        inner.desk.leave(client);
        self.looking.store(inner.desk.clients(), Ordering::Relaxed);
        self.tell(&inner);
    }

    pub(crate) fn command(&self, client: Client, command: &Command) -> Answer {
        let mut inner = self.inner();
        let answer = inner.desk.command(client, command);
        self.tell(&inner);
        answer
    }

    pub(crate) fn closed(&self) -> bool {
        matches!(self.inner().desk.stage(), Stage::Closed(_))
    }

    /// How the flight ended, once the bench is to end.
    fn closing(&self) -> Option<Outcome> {
        self.inner().closing.clone()
    }

    fn set_stage(&self, stage: Stage) {
        let mut inner = self.inner();
        inner.desk.set_stage(stage);
        self.tell(&inner);
    }

    fn tell(&self, inner: &Inner) {
        self.state.send_replace(inner.desk.as_json().to_string().into());
    }

    fn publish(&self, batch: String) {
        let batch = Utf8Bytes::from(batch);
        let mut inner = self.inner();
        inner.history_bytes += batch.len();
        inner.history.push_back(batch.clone());
        while inner.history_bytes > HISTORY
            && let Some(oldest) = inner.history.pop_front()
        {
            inner.history_bytes -= oldest.len();
        }
        // Nobody may be there.
        let _ = inner.batches.send(batch);
    }
}

/// The live page of one flight, as the command has it.
pub struct Live {
    shared: Arc<Shared>,
    pressed: mpsc::Receiver<Pressed>,
    address: SocketAddr,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    /// Serves the page on `listen` (port 0: any that is free), from a thread of ordinary priority: to be called by one. `records` is the far end of
    /// the flight's queue, `missed` how many records found it full.
    pub fn start(
        listen: SocketAddr,
        about: About,
        records: Consumer<Record>,
        missed: Arc<AtomicU64>,
    ) -> Result<(Self, Controls), ViewError> {
        let refused = |source| ViewError::Listen { address: listen, source };
        let listener = TcpListener::bind(listen).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        // Connections inherit it. The system would let megabytes wait for a browser that is slow, which would see old views.
        socket2::SockRef::from(&listener).set_send_buffer_size(SEND_BUFFER).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let (commands, controls) = controls::channel();
        let telemetry = Telemetry::new(&about.rig);
        let told = about.as_json();
        let (desk, pressed) = Desk::new(about, commands);
        let (batches, _) = broadcast::channel(BATCHES);
        let shared = Arc::new(Shared {
            looking: AtomicUsize::new(0),
            views: watch::Sender::new(None),
            state: watch::Sender::new(Utf8Bytes::from(desk.as_json().to_string())),
            token: Token::random()?,
            about: told,
            port: address.port(),
            inner: Mutex::new(Inner {
                desk,
                batches,
                history: VecDeque::new(),
                history_bytes: 0,
                closing: None,
            }),
        });
        let failed = |source| ViewError::Thread { thread: "live", source };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
        let thread = {
            let shared = Arc::clone(&shared);
            let hub = Hub { records, missed, telemetry };
            thread::Builder::new()
                .name("live".to_owned())
                .spawn(move || runtime.block_on(serve(listener, shared, hub)))
                .map_err(failed)?
        };
        Ok((Self { shared, pressed, address, thread: Some(thread) }, controls))
    }

    /// Where the page is: with the token, which no server and no log ever sees, as it stands behind the `#`.
    pub fn url(&self) -> String {
        let host = match self.address.ip() {
            ip if !ip.is_unspecified() => self.address.ip(),
            IpAddr::V4(_) => std::net::Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(_) => std::net::Ipv6Addr::LOCALHOST.into(),
        };
        format!("http://{}/#{}", SocketAddr::new(host, self.address.port()), self.shared.token)
    }

    /// Whether other machines can reach it.
    pub fn is_exposed(&self) -> bool {
        !self.address.ip().is_loopback()
    }

    /// Tells the page where the bench is.
    pub fn stage(&self, stage: Stage) {
        self.shared.set_stage(stage);
    }

    /// Who flies shows frames to what this gives.
    pub fn frames(&self, calibration: &Calibration) -> Result<Frames, ViewError> {
        Frames::start(calibration, Arc::clone(&self.shared))
    }

    /// Waits for START; `None` when the operator ended the bench instead.
    pub async fn started(&mut self) -> Option<Start> {
        match self.pressed.recv().await {
            Some(Pressed::Start(start)) => Some(*start),
            Some(Pressed::End) | None => None,
        }
    }

    /// Waits until the operator ends the bench.
    pub async fn ended(&mut self) {
        while let Some(Pressed::Start(_)) = self.pressed.recv().await {}
    }

    /// Tells the pages that the bench ends, gives them a moment to hear it, and ends the server.
    pub fn close(mut self, outcome: Outcome) {
        self.shared.inner().closing = Some(outcome);
        if let Some(thread) = self.thread.take() {
            // That the page failed is no reason for the flight to fail.
            let _ = thread.join();
        }
    }
}

/// What is between the flight's queue and the browsers.
struct Hub {
    records: Consumer<Record>,
    missed: Arc<AtomicU64>,
    telemetry: Telemetry,
}

impl Hub {
    /// Takes what the flight has recorded since, as one batch; whether there may be more.
    fn turn(&mut self, shared: &Shared) -> bool {
        let mut taken = 0;
        while taken < AT_A_TIME
            && let Ok(record) = self.records.pop()
        {
            self.telemetry.take(&record);
            taken += 1;
        }
        if let Some(phase) = self.telemetry.phase() {
            shared.inner().desk.set_phase(phase);
        }
        if let Some(batch) = self.telemetry.batch(self.missed.load(Ordering::Relaxed)) {
            shared.publish(batch);
        }
        taken == AT_A_TIME
    }

    /// Until the bench ends and the browsers have heard it.
    async fn run(mut self, shared: &Shared) {
        let mut every = tokio::time::interval(BATCH);
        every.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let outcome = loop {
            let closing = shared.closing();
            while self.turn(shared) {
                tokio::task::yield_now().await;
            }
            if let Some(outcome) = closing {
                break outcome;
            }
            every.tick().await;
        };
        shared.set_stage(Stage::Closed(outcome));
        let gone = async {
            while shared.looking.load(Ordering::Relaxed) > 0 {
                every.tick().await;
            }
        };
        // A browser that does not listen is not waited for.
        let _ = tokio::time::timeout(GOODBYE, gone).await;
    }
}

async fn serve(listener: TcpListener, shared: Arc<Shared>, hub: Hub) {
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    let app = Router::new()
        .route("/", asset("text/html; charset=utf-8", include_str!("page/index.html")))
        .route("/live.css", asset("text/css; charset=utf-8", STYLE))
        .route("/live.js", asset(SCRIPT, include_str!("page/live.js")))
        .route("/traces.js", asset(SCRIPT, include_str!("page/traces.js")))
        .route("/space.js", asset(SCRIPT, include_str!("page/space.js")))
        .route("/uplot.js", asset(SCRIPT, bench_page::UPLOT_JS))
        .route("/uplot.css", asset("text/css; charset=utf-8", bench_page::UPLOT_CSS))
        .route("/page.css", asset("text/css; charset=utf-8", bench_page::style()))
        .route("/live", any(upgrade))
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), guard))
        .with_state(Arc::clone(&shared));
    tokio::select! {
        _ = axum::serve(listener, app).into_future() => {}
        () = hub.run(&shared) => {}
    }
}

const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = include_str!("page/live.css");

fn asset(kind: &'static str, text: impl Into<Bytes>) -> MethodRouter<Arc<Shared>> {
    let text = text.into();
    get(move || async move { ([(header::CONTENT_TYPE, kind)], text) })
}

/// Refuses requests that were meant for another host, as a name that was turned to this machine has them, and tells browsers what the page may do.
async fn guard(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response<Body> {
    let host = host(request.headers()).unwrap_or_default().to_owned();
    let mut response = if is_own(&host, shared.port) {
        next.run(request).await
    } else {
        let words = "this is the live page of a bench; open it by the address on the bench's terminal\n";
        (StatusCode::MISDIRECTED_REQUEST, words).into_response()
    };
    let policy = format!(
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self' ws://{host}; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'"
    );
    let headers = response.headers_mut();
    if let Ok(policy) = HeaderValue::from_str(&policy) {
        headers.insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

fn host(headers: &HeaderMap) -> Option<&str> {
    headers.get(header::HOST)?.to_str().ok()
}

/// Whether a request names this machine by an address or as `localhost`: a name of somebody else's may lead here too.
fn is_own(host: &str, port: u16) -> bool {
    let (name, given) = match host.rsplit_once(':') {
        Some((name, given)) if !given.ends_with(']') => (name, given.parse().ok()),
        _ => (host, Some(80)),
    };
    let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    given == Some(port) && (name == "localhost" || address.parse::<IpAddr>().is_ok())
}

/// A page of ours, from this very address, and nobody else's.
async fn upgrade(
    State(shared): State<Arc<Shared>>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response<Body> {
    let origin = headers.get(header::ORIGIN).and_then(|origin| origin.to_str().ok());
    let own = host(&headers).map(|host| format!("http://{host}"));
    if origin.is_none() || origin != own.as_deref() {
        return (StatusCode::FORBIDDEN, "only the bench's own page may connect\n").into_response();
    }
    upgrade.max_message_size(socket::LONGEST).on_upgrade(move |socket| socket::talk(socket, shared))
}

/// What a browser is told first.
pub(crate) fn welcome(shared: &Shared, client: Client) -> String {
    json!({ "type": "welcome", "client": client, "about": shared.about }).to_string()
}

#[cfg(test)]
mod tests {
    use super::is_own;

    #[test]
    fn only_addresses_and_localhost_are_ours() {
        for host in ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "192.168.1.5:8080"] {
            assert!(is_own(host, 8080), "{host}");
        }
        for host in [
            "evil.example:8080",
            "127.0.0.1",
            "127.0.0.1:80",
            "localhost.evil.example:8080",
            "",
            "[::1]",
            "127.0.0.1.evil:8080",
        ] {
            assert!(!is_own(host, 8080), "{host}");
        }
        assert!(is_own("127.0.0.1", 80) && is_own("[::1]", 80));
    }
}
