//! `--foxglove`: a plain WebSocket client that speaks Foxglove's protocol sees what the recording holds. No test runs the applications.

use std::{
    collections::BTreeMap,
    fs,
    net::TcpStream,
    sync::{Arc, Mutex},
};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use bench_recording::{Observer, Options, Recorder, Recording, ViewerChannel};
use serde_json::{Value, json};
use tungstenite::{ClientRequestBuilder, Message, WebSocket};

use crate::support::{Scratch, Serving, bench};

/// Topic, log time in nanoseconds, and the message.
type Seen = (String, u64, Vec<u8>);

/// Topic to the schema's name and descriptor set.
type Schemas = BTreeMap<String, (String, Vec<u8>)>;

/// `bench` with a server.
struct Bench(Serving);

impl Bench {
    fn start(arguments: &[&str]) -> Self {
        let serve = ["--realtime", "--foxglove", "127.0.0.1:0"];
        Self(Serving::start(&[arguments, &serve].concat(), "foxglove: ws://"))
    }

    fn viewer(&self) -> Viewer {
        let host = &self.0.address;
        let request = ClientRequestBuilder::new(format!("ws://{host}/").parse().unwrap())
            .with_sub_protocol("foxglove.sdk.v1");
        let socket = Serving::connect(host, request);
        Viewer { socket, topics: BTreeMap::new(), schemas: Schemas::new() }
    }

    /// The exit code.
    fn end(self) -> Option<i32> {
        self.0.end().0
    }
}

/// Subscribes to all that is advertised.
struct Viewer {
    socket: WebSocket<TcpStream>,
    /// By the number of the subscription, which is the channel's.
    topics: BTreeMap<u64, String>,
    schemas: Schemas,
}

impl Viewer {
    /// The next message of a channel; `None` at the end of the flight.
    fn next(&mut self) -> Option<Seen> {
        loop {
            match self.socket.read() {
                Ok(Message::Text(text)) => self.hear(&serde_json::from_str(&text).unwrap()),
                Ok(Message::Binary(data)) => {
                    // Opcode, subscription, time, message.
                    assert_eq!(data[0], 1);
                    let subscription = u32::from_le_bytes(data[1..5].try_into().unwrap());
                    let time_ns = u64::from_le_bytes(data[5..13].try_into().unwrap());
                    let topic = self.topics[&u64::from(subscription)].clone();
                    return Some((topic, time_ns, data[13..].to_vec()));
                }
                Ok(_) => {}
                Err(tungstenite::Error::ConnectionClosed) => return None,
                Err(error) => panic!("the connection ended: {error}, subscribed to {:?}", self.topics),
            }
        }
    }

    fn hear(&mut self, message: &Value) {
        match message["op"].as_str().unwrap() {
            "serverInfo" => assert_eq!(message["name"], "bench"),
            "advertise" => {
                for channel in message["channels"].as_array().unwrap() {
                    assert_eq!(
                        (&channel["encoding"], &channel["schemaEncoding"]),
                        (&json!("protobuf"), &json!("protobuf"))
                    );
                    let [topic, schema, set] = ["topic", "schemaName", "schema"]
                        .map(|key| channel[key].as_str().unwrap().to_owned());
                    let id = channel["id"].as_u64().unwrap();
                    self.schemas.insert(topic.clone(), (schema, STANDARD.decode(set).unwrap()));
                    self.topics.insert(id, topic);
                    let subscribe =
                        json!({ "op": "subscribe", "subscriptions": [{ "id": id, "channelId": id }] });
                    // The flight may end meanwhile.
                    let _ = self.socket.send(Message::text(subscribe.to_string()));
                }
            }
            _ => {}
        }
    }
}

/// What a recording holds, but for images.
#[derive(Clone, Default)]
struct Held(Arc<Mutex<(Vec<Seen>, Schemas)>>);

impl Observer for Held {
    fn see(&mut self, message: &bench_recording::Message<'_>) {
        let (messages, schemas) = &mut *self.0.lock().unwrap();
        messages.push((message.topic.to_owned(), message.log_time_ns, message.data.to_vec()));
        schemas
            .insert(message.topic.to_owned(), (message.schema.to_owned(), message.descriptor_set.to_vec()));
    }
}

/// Records write the same messages whenever they are recorded.
fn held(scratch: &Scratch, recording: &str) -> (Vec<Seen>, Schemas) {
    let recording = Recording::open(recording).unwrap();
    let held = Held::default();
    let again = scratch.path("again.mcap");
    let observer: Box<dyn Observer> = Box::new(held.clone());
    let mut recorder =
        Recorder::create_observed(again, recording.session(), Options::SIMULATION, Some(observer)).unwrap();
    for record in recording.records().unwrap() {
        recorder.record(record.unwrap());
    }
    recorder.finish().unwrap();
    std::mem::take(&mut *held.0.lock().unwrap())
}

fn is_image(topic: &str) -> bool {
    [ViewerChannel::Full, ViewerChannel::Red, ViewerChannel::Depth].iter().any(|image| image.topic() == topic)
}

#[test]
fn viewers_see_what_is_recorded_and_one_that_reads_nothing_costs_nothing() {
    let scratch = Scratch::new();
    let [served, alone] = ["served.mcap", "alone.mcap"].map(|name| scratch.name(name));
    let flight = ["sim", "--mission", "hop", "--frames", "--record-views", "3", "--seed", "3"];
    let bench_served = Bench::start(&[&flight[..], &["-o", &served]].concat());
    let mut viewer = bench_served.viewer();
    // More is sent to this one than any socket's buffers take.
    let mut stalled = bench_served.viewer();
    let mut seen = vec![viewer.next().expect("a message")];
    stalled.next().expect("a message");
    // The scene was sent long ago when this one comes.
    while seen.last().unwrap().0 != "/tracker/position" {
        seen.push(viewer.next().expect("a position"));
    }
    let mut late = bench_served.viewer();
    let scene = std::iter::from_fn(|| late.next()).find(|(topic, ..)| topic == "/scene");
    drop(late);
    seen.extend(std::iter::from_fn(|| viewer.next()));
    assert_eq!(bench_served.end(), Some(0));
    drop(stalled);

    bench(flight).args(["-o", &alone]).assert().success();
    assert!(fs::read(&served).unwrap() == fs::read(&alone).unwrap());

    let (messages, schemas) = held(&scratch, &served);
    assert!(messages.contains(&scene.expect("the scene")));
    assert!(viewer.schemas.keys().any(|topic| is_image(topic)));
    for (topic, schema) in &schemas {
        assert_eq!(&viewer.schemas[topic].0, &schema.0, "{topic}");
        assert!(viewer.schemas[topic].1 == schema.1, "{topic}");
    }
    // In the recording's order; the queue of a slow viewer may have dropped some.
    for topic in schemas.keys() {
        let mut held = messages.iter().filter(|message| message.0 == *topic);
        let mut of_topic: Vec<_> = seen.iter().filter(|message| message.0 == *topic).collect();
        of_topic.dedup();
        for message in of_topic {
            assert!(held.any(|held| held == message), "{topic} at {} ns", message.1);
        }
    }
    assert!(seen.iter().any(|message| message.0 == "/control/state"));
    assert!(seen.iter().any(|message| is_image(&message.0)));
}
