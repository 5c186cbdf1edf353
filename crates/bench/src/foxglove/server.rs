//! The server, with Foxglove's own SDK: it keeps the protocol in step with the applications.

use std::{
    collections::HashMap,
    net::SocketAddr,
    sync::{Arc, Mutex, PoisonError, mpsc},
    thread,
    time::Duration,
};

use anyhow::{Context as _, anyhow};
use bench_recording::{Message, Observer};
use foxglove::{
    ChannelBuilder, Context, PartialMetadata, RawChannel, Schema,
    websocket::{ChannelView, Client, ServerListener},
};
use tokio::{runtime::Handle, sync::oneshot};

use crate::words;

/// How long clients are waited for at the end.
const FAREWELL: Duration = Duration::from_secs(1);

/// Serves until it is dropped.
pub struct Server {
    context: Arc<Context>,
    kept: Arc<Kept>,
    runtime: Handle,
    /// Dropped to end it.
    end: Option<oneshot::Sender<()>>,
    ended: mpsc::Receiver<()>,
}

/// The messages that hold for all of the flight, by topic: whoever connects later gets them too.
#[derive(Default)]
struct Kept(Mutex<HashMap<&'static str, KeptMessage>>);

struct KeptMessage {
    channel: Arc<RawChannel>,
    log_time_ns: u64,
    data: Vec<u8>,
}

impl Server {
    /// Listens, on a thread of its own, and says where.
    pub fn open(address: SocketAddr) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let handle = runtime.handle().clone();
        let context = Context::new();
        let kept = Arc::new(Kept::default());
        let host = match address {
            SocketAddr::V4(address) => address.ip().to_string(),
            SocketAddr::V6(address) => format!("[{}]", address.ip()),
        };
        let server = context
            .websocket_server()
            .name("bench")
            .bind(host.as_str(), address.port())
            .listener(Arc::clone(&kept) as Arc<dyn ServerListener>);
        let (end, until) = oneshot::channel::<()>();
        let (started_sender, started) = mpsc::channel();
        let (ended_sender, ended) = mpsc::channel();
        let serve = async move {
            let handle = match server.start().await {
                Ok(handle) => handle,
                Err(error) => return drop(started_sender.send(Err(error))),
            };
            let _ = started_sender.send(Ok(handle.port()));
            let _ = until.await;
            let _ = tokio::time::timeout(FAREWELL, handle.stop().wait()).await;
            let _ = ended_sender.send(());
        };
        thread::Builder::new().name("foxglove".to_owned()).spawn(move || runtime.block_on(serve))?;
        let port = started
            .recv()
            .map_err(|_| anyhow!("its thread failed"))
            .and_then(|started| started.map_err(anyhow::Error::from))
            .with_context(|| {
                format!(
                    "cannot serve Foxglove on {address}; is another bench running? name another port with --foxglove"
                )
            })?;
        if !address.ip().is_loopback() {
            words::warn(format_args!(
                "Foxglove's server listens on {address}, where other machines reach it; whoever connects sees the flight"
            ));
        }
        crate::words::say!("foxglove: ws://{host}:{port}");
        Ok(Self { context, kept, runtime: handle, end: Some(end), ended })
    }

    /// What the recorder shows its messages to.
    pub fn observer(&self) -> Box<dyn Observer> {
        Box::new(Publisher {
            context: Arc::clone(&self.context),
            kept: Arc::clone(&self.kept),
            runtime: self.runtime.clone(),
            channels: HashMap::new(),
        })
    }
}

impl Drop for Server {
    /// Says farewell to whoever is connected.
    fn drop(&mut self) {
        drop(self.end.take());
        let _ = self.ended.recv_timeout(FAREWELL);
    }
}

/// Passes messages on. The queue of each client is bounded and drops what is oldest, so that none of them delays the recorder.
struct Publisher {
    context: Arc<Context>,
    kept: Arc<Kept>,
    runtime: Handle,
    /// By topic, from its first message on. None where the SDK refused it.
    channels: HashMap<&'static str, Option<Arc<RawChannel>>>,
}

impl Observer for Publisher {
    fn see(&mut self, message: &Message<'_>) {
        let channel = self
            .channels
            .entry(message.topic)
            .or_insert_with(|| advertise(&self.runtime, &self.context, message));
        let Some(channel) = channel else { return };
        if message.is_static {
            self.kept.keep(channel, message);
        }
        channel.log_with_meta(message.data, PartialMetadata::with_log_time(message.log_time_ns));
    }
}

/// On the server's own thread: the SDK tells clients of a channel before it knows the channel itself, and would refuse a client that
/// subscribes in between. Waits for it, once a topic.
fn advertise(runtime: &Handle, context: &Arc<Context>, message: &Message<'_>) -> Option<Arc<RawChannel>> {
    let schema = Schema::new(message.schema, "protobuf", message.descriptor_set);
    let channel =
        ChannelBuilder::new(message.topic).context(context).message_encoding("protobuf").schema(schema);
    let (sender, built) = mpsc::channel();
    runtime.spawn(async move {
        let _ = sender.send(channel.build_raw().ok());
    });
    built.recv().ok().flatten()
}

impl Kept {
    fn keep(&self, channel: &Arc<RawChannel>, message: &Message<'_>) {
        let kept = KeptMessage {
            channel: Arc::clone(channel),
            log_time_ns: message.log_time_ns,
            data: message.data.to_vec(),
        };
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(message.topic, kept);
    }
}

impl ServerListener for Kept {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = kept.get(channel.topic()) {
            let time = PartialMetadata::with_log_time(kept.log_time_ns);
            kept.channel.log_with_meta_to_sink(&kept.data, time, client.sink_id());
        }
    }
}
