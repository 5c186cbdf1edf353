//! Views of frames get their place in a recording, whatever the threads do.

mod common;

use std::fs;

use bench_device::Time;
use bench_recording::{Channel, Images, Options, Recorder, Recording, View, ViewerChannel};
use common::{flight, session};
use tempfile::tempdir;

const SIZE: [u32; 2] = [8, 4];

fn view(channel: ViewerChannel, at: Time, shade: u8, mut rgb: Vec<u8>) -> View {
    rgb.clear();
    rgb.resize((3 * SIZE[0] * SIZE[1]) as usize, shade);
    View { channel, exposed_at: at.shifted(-0.3), arrived_at: at, size: SIZE, rgb }
}

/// A flight with the three views of every tenth record.
fn record(path: &std::path::Path) -> u64 {
    let mut recorder = Recorder::create(path, &session(), Options::SIMULATION).unwrap();
    let mut images: Images = recorder.images().unwrap();
    assert!(recorder.images().is_none());
    let mut given = 0;
    for (i, record) in flight(4.0).into_iter().enumerate() {
        if i % 10 == 0 {
            for channel in [ViewerChannel::Full, ViewerChannel::Red, ViewerChannel::Depth] {
                let buffer = images.buffer();
                assert!(images.give(view(channel, record.time(), i as u8, buffer)));
                given += 1;
            }
        }
        recorder.record(record);
    }
    assert_eq!(recorder.finish().unwrap().dropped_views, 0);
    given
}

#[test]
fn a_simulation_loses_no_view_and_its_bytes_repeat() {
    let folder = tempdir().unwrap();
    let [a, b] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    let given = record(&a);
    record(&b);
    let bytes = fs::read(&a).unwrap();
    assert!(bytes == fs::read(b).unwrap());
    let (mut seen, mut before_ns, mut records) = (0, 0, 0);
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        // What viewers draw of a record has its time.
        assert!(message.log_time >= before_ns, "{}", message.channel.topic);
        before_ns = message.log_time;
        if message.channel.topic.starts_with("/camera/") {
            // Each view lies right before the record that came after it.
            assert_eq!(records % 10, 0);
            assert_eq!(message.channel.schema.as_ref().unwrap().name, "foxglove.CompressedImage");
            seen += 1;
        }
        records += usize::from(Channel::from_topic(&message.channel.topic).is_some());
    }
    assert_eq!(seen, given);
    // Whoever reads the flight sees none of them.
    let read: Vec<_> = Recording::open(&a).unwrap().records().unwrap().map(Result::unwrap).collect();
    assert_eq!(read, flight(4.0));
}

#[test]
fn a_loop_in_real_time_never_waits_for_views() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("real.mcap");
    let mut recorder = Recorder::create(&path, &session(), Options::REAL_TIME).unwrap();
    let mut images = recorder.images().unwrap();
    // More at once than there is room for: large enough that the writer cannot keep up.
    let size = [1920, 1080];
    let rgb = vec![0x5a; (3 * size[0] * size[1]) as usize];
    let mut dropped = 0;
    for i in 0..40 {
        let arrived_at = Time::from_seconds(f64::from(i));
        let given =
            View { channel: ViewerChannel::Full, exposed_at: arrived_at, arrived_at, size, rgb: rgb.clone() };
        dropped += u64::from(!images.give(given));
    }
    assert_eq!(images.dropped(), dropped);
    let finished = recorder.finish().unwrap();
    assert_eq!(finished.dropped_views, dropped);
    assert_eq!(finished.messages, 40 - dropped);
    // A recorder that is gone takes no more.
    assert!(!images.give(view(ViewerChannel::Red, Time::ZERO, 0, Vec::new())));
}

#[test]
fn a_view_whose_size_is_not_that_of_its_pixels_fails_the_recording() {
    let folder = tempdir().unwrap();
    let mut recorder =
        Recorder::create(folder.path().join("x.mcap"), &session(), Options::SIMULATION).unwrap();
    let mut images = recorder.images().unwrap();
    images.give(View { size: [9, 4], ..view(ViewerChannel::Full, Time::ZERO, 0, Vec::new()) });
    let error = recorder.finish().unwrap_err();
    assert!(error.to_string().contains("x.mcap"), "{error}");
}
