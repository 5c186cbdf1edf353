use std::{collections::BTreeMap, io::Cursor};

use bench_logs::Format;
use mcap::{WriteOptions, records::MessageHeader};

use crate::{beginnings_hold, names, read};

const POSE: &str = "std_msgs/Header header\ngeometry_msgs/Point position\n\
    ================================================================================\nMSG: std_msgs/Header\n\
    builtin_interfaces/Time stamp\nstring frame_id\n\
    ================================================================================\nMSG: geometry_msgs/Point\n\
    float64 x\nfloat64 y\nfloat64 z\n";

/// A bag of 10 ms steps with a pose in CDR and a voltage in JSON in each, in chunks of 256 bytes and more.
pub fn log(steps: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let options = WriteOptions::new().chunk_size(Some(256)).compression(None);
    let mut writer = options.create(Cursor::new(&mut bytes)).unwrap();
    let pose = writer.add_schema("x_msgs/msg/Pose", "ros2msg", POSE.as_bytes()).unwrap();
    let poses = writer.add_channel(pose, "/pose", "cdr", &BTreeMap::new()).unwrap();
    let volts = writer.add_channel(0, "/battery", "json", &BTreeMap::new()).unwrap();
    for k in 0..steps {
        let nanos = u64::from(k) * 10_000_000;
        let header =
            |channel_id| MessageHeader { channel_id, sequence: k, log_time: nanos, publish_time: nanos };
        let mut message = vec![0, 1, 0, 0];
        message.extend(k.to_le_bytes());
        message.extend(5_u32.to_le_bytes());
        message.extend(4_u32.to_le_bytes());
        message.extend(b"map\0");
        for number in [0.5, -0.5, f64::from(k)] {
            message.extend(number.to_le_bytes());
        }
        writer.write_to_known_channel(&header(poses), &message).unwrap();
        let json = format!("{{ \"volts\": {{ \"cells\": [3.5, {k}] }} }}");
        writer.write_to_known_channel(&header(volts), json.as_bytes()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

#[test]
fn messages_in_cdr_and_json_have_their_fields() {
    let read = read(Format::Mcap, &log(3)).unwrap();
    assert_eq!(names(&read), ["/pose", "/battery"]);
    let fields: Vec<_> = read.topics[0].fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(fields, ["header.stamp", "header.frame_id", "position.x", "position.y", "position.z"]);
    assert_eq!(read.samples[4].time_ns, Some(20_000_000));
    assert_eq!(read.samples[4].cells, ["2000000005", "map", "0.5", "-0.5", "2"]);
    assert_eq!(read.topics[1].fields[1].name, "volts.cells[1]");
    assert_eq!(read.samples[5].cells, ["3.5", "2"]);
}

#[test]
fn a_cut_bag_gives_the_chunks_that_are_whole() {
    let bytes = log(12);
    let whole = read(Format::Mcap, &bytes).unwrap();
    assert!(whole.losses.is_none(), "{:?}", whole.losses);
    beginnings_hold(Format::Mcap, &bytes, 0);
    let half = read(Format::Mcap, &bytes[..bytes.len() / 2]).unwrap();
    assert!(half.losses.cut && !half.samples.is_empty(), "{:?}", half.losses);
}

#[test]
fn a_chunk_whose_checksum_does_not_hold_is_counted_and_the_others_are_read() {
    let bytes = log(12);
    let whole = read(Format::Mcap, &bytes).unwrap();
    // The frame's name stands in each pose; in the sixth it is another.
    let at = bytes.windows(4).enumerate().filter(|(_, part)| *part == b"map\0").nth(5).unwrap().0;
    let mut damaged = bytes.clone();
    damaged[at] = b'M';
    let part = read(Format::Mcap, &damaged).unwrap();
    assert_eq!(part.losses.damaged, 1);
    assert!(part.samples.len() < whole.samples.len() && part.samples.len() > whole.samples.len() / 2);
    assert!(part.samples.iter().all(|sample| whole.samples.contains(sample)));
}
