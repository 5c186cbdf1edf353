//! The driver against an emulated Kinect at the other end of a cable within this process: no kernel, no waiting, time as the test says.

use std::sync::{
    Arc, Mutex,
    atomic::{AtomicU64, Ordering},
};

use bench_device::{DeviceError, Time};
use bench_kinect::{
    Frame, FrameSource,
    camera::Disparity,
    frame::{PIXELS, ticks_at},
    usb::{
        Blocks, DriverError, Kinect, Led, Model, Motor, SILENCE_S, Settings, Streaming, Transport,
        TransportError,
        emulator::{Cable, Camera, Foot, MICROFRAMES, PacketFaults},
    },
};
use bench_rig::{Depth, Rig};

fn depth() -> Depth {
    let rig = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/virtual.toml");
    Rig::load(rig).unwrap().calibration.unwrap().depth
}

/// Frame number `i`: something of every value, another for every number.
fn frame(i: u64) -> Frame {
    let mut frame = Frame::default();
    for (pixel, (colour, depth)) in frame.colour.iter_mut().zip(&mut frame.depth).enumerate() {
        *colour = (pixel as u64 * 31 + i * 7) as u8;
        *depth = ((pixel as u64 * 13 + i * 101) % 2048) as u16;
    }
    let exposed = Time::from_seconds(i as f64 / 30.0);
    frame.colour_ticks = ticks_at(exposed);
    frame.depth_ticks = ticks_at(exposed.shifted(0.001));
    frame
}

/// A Kinect on a cable, and the host's clock.
struct Bench {
    cable: Cable,
    clock: Arc<AtomicU64>,
}

impl Bench {
    fn new(faults: PacketFaults) -> Self {
        let camera = Camera::new(Model::Xbox1414, Blocks::of(&depth()));
        Self { cable: Cable::new(camera, faults, 1), clock: Arc::default() }
    }

    fn open(&self) -> Kinect {
        Kinect::new(Box::new(self.cable.clone()), None, Model::Xbox1414, "A0".to_owned()).unwrap()
    }

    fn stream(&self, settings: Settings) -> Streaming {
        let clock = Arc::clone(&self.clock);
        self.open().stream(settings, move || Time::from_nanos(clock.load(Ordering::Relaxed))).unwrap()
    }

    fn carry(&self, frame: &Frame) {
        self.cable.carry(frame, || _ = self.clock.fetch_add(125_000, Ordering::Relaxed));
    }
}

#[test]
fn a_kinect_gives_its_constants_and_its_depths_follow_from_them() {
    let bench = Bench::new(PacketFaults::default());
    let kinect = bench.open();
    let (blocks, depth) = (kinect.blocks(), depth());
    assert_eq!(blocks.differences(&depth), []);
    let other = Depth { const_shift: 180.0, ..depth };
    assert_eq!(blocks.differences(&other), [("const_shift", 180.0, 200.0)]);
    assert_eq!(blocks.applied(&other).const_shift, 200.0);
    // Check values of OpenKinect's arithmetic with the usual constants.
    let law = Disparity::new(&blocks.applied(&other), 1.0, 0.0);
    assert!((law.depth_m(800.0).unwrap() - 1.194).abs() < 5e-4);
    assert!((law.depth_m(1000.0).unwrap() - 3.864).abs() < 5e-4);
}

#[test]
fn frames_arrive_bit_for_bit_and_paired() {
    let bench = Bench::new(PacketFaults::default());
    let mut streaming = bench.stream(Settings::default());
    for i in 0..5 {
        let sent = frame(i);
        bench.carry(&sent);
        let received = streaming.poll_frame().unwrap().unwrap();
        assert!(received.colour == sent.colour && received.depth == sent.depth);
        assert!(received.colour_valid.is_whole() && received.depth_valid.is_whole());
        assert_eq!((received.colour_ticks, received.depth_ticks), (sent.colour_ticks, sent.depth_ticks));
        // Depth takes 242 microframes: complete when that one has begun.
        let arrived = i as f64 * MICROFRAMES as f64 * 125e-6 + 242.0 * 125e-6;
        // The frame period is 267 microframes, not quite a thirtieth of a second: 42 us a frame.
        assert!((received.arrived_at.seconds() - arrived).abs() < 3e-4, "{i}: {:?}", received.arrived_at);
        assert!(streaming.poll_frame().unwrap().is_none());
    }
    let statistics = streaming.statistics();
    assert_eq!((statistics.frames, statistics.unpaired, statistics.overrun), (5, 0, 0));
}

#[test]
fn frames_that_nobody_takes_are_counted_and_the_rest_still_comes_in_order() {
    let bench = Bench::new(PacketFaults::default());
    let mut streaming = bench.stream(Settings::default());
    for i in 0..20 {
        bench.carry(&frame(i));
    }
    let mut ticks = Vec::new();
    while let Some(frame) = streaming.poll_frame().unwrap() {
        ticks.push(frame.colour_ticks);
    }
    assert!(ticks.len() >= 7 && ticks.is_sorted(), "{ticks:?}");
    assert!(streaming.statistics().overrun > 0);
    bench.carry(&frame(20));
    assert_eq!(streaming.poll_frame().unwrap().unwrap().colour_ticks, frame(20).colour_ticks);
}

#[test]
fn exposure_and_white_balance_are_set_and_streams_stopped_in_the_end() {
    let bench = Bench::new(PacketFaults::default());
    let streaming = bench.stream(Settings::default());
    assert_eq!((bench.cable.camera().exposure_s(), bench.cable.camera().balances()), (None, true));
    drop(streaming);
    let streaming = bench.stream(Settings { exposure_s: Some(0.010), hold_white_balance: true });
    let camera = bench.cable.camera();
    // Half a unit of the shutter.
    assert!((camera.exposure_s().unwrap() - 0.010).abs() < 28e-6 && !camera.balances());
    assert!(bench_kinect::usb::Stream::ALL.iter().all(|stream| camera.runs(*stream)));
    drop(streaming);
    let camera = bench.cable.camera();
    assert!(bench_kinect::usb::Stream::ALL.iter().all(|stream| !camera.runs(*stream)));
    for wrong in [0.0, -1.0, 0.1, f64::NAN] {
        let settings = Settings { exposure_s: Some(wrong), ..Settings::default() };
        let error = bench.open().stream(settings, || Time::ZERO).err().unwrap();
        assert!(matches!(error, DriverError::OutOfRange { .. }), "{error}");
    }
}

#[test]
fn unplugging_in_mid_stream_is_told_once_what_had_come_is_taken() {
    let bench = Bench::new(PacketFaults::default());
    let mut streaming = bench.stream(Settings::default());
    bench.carry(&frame(0));
    bench.cable.unplug();
    assert!(streaming.poll_frame().unwrap().is_some());
    let error = streaming.poll_frame().unwrap_err();
    assert!(matches!(error, DeviceError::Gone { .. }), "{error}");
    drop(streaming);
    let again = Kinect::new(Box::new(bench.cable.clone()), None, Model::Xbox1414, String::new());
    assert!(matches!(again.err(), Some(DriverError::Gone)));
}

#[test]
fn a_stream_that_stands_still_is_a_time_out_and_comes_back() {
    let bench = Bench::new(PacketFaults::default());
    let mut streaming = bench.stream(Settings::default());
    bench.carry(&frame(0));
    assert!(streaming.poll_frame().unwrap().is_some());
    bench.clock.fetch_add((SILENCE_S * 1e9) as u64 + 1_000_000_000, Ordering::Relaxed);
    assert!(matches!(streaming.poll_frame(), Err(DeviceError::TimedOut { .. })));
    bench.carry(&frame(90));
    assert!(streaming.poll_frame().unwrap().is_some());
    assert!(streaming.poll_frame().unwrap().is_none());
}

/// Whatever is lost on the way: a frame is whole, or says which pixels are missing, or does not come.
fn soak(seconds: u64, faults: PacketFaults) -> bench_kinect::usb::Statistics {
    let bench = Bench::new(faults);
    let mut streaming = bench.stream(Settings::default());
    let frames: Vec<Frame> = (0..30).map(frame).collect();
    let mut sent = Frame::default();
    for i in 0..seconds * 30 {
        sent.clone_from(&frames[(i % 30) as usize]);
        let exposed = Time::from_seconds(i as f64 * MICROFRAMES as f64 * 125e-6);
        sent.colour_ticks = ticks_at(exposed);
        sent.depth_ticks = ticks_at(exposed.shifted(0.001));
        bench.carry(&sent);
        while let Some(received) = streaming.poll_frame().unwrap() {
            // A frame may come with the first packets of the next, when its own last ones are lost.
            let late = sent
                .colour_ticks
                .wrapping_sub(received.colour_ticks)
                .min(sent.depth_ticks.wrapping_sub(received.depth_ticks));
            assert!(late <= 2_002_500, "frame {i} is {late} ticks late");
            let whose = if late == 0 { i } else { i - 1 };
            let truth = &frames[(whose % 30) as usize];
            for pixel in 0..PIXELS {
                assert!(
                    !received.colour_valid.received(pixel) || received.colour[pixel] == truth.colour[pixel]
                );
                assert!(!received.depth_valid.received(pixel) || received.depth[pixel] == truth.depth[pixel]);
            }
        }
    }
    streaming.statistics()
}

#[test]
fn ten_seconds_with_two_percent_of_packets_lost() {
    let statistics = soak(10, PacketFaults { loss: 0.02, cut: 0.0 });
    let [colour, depth] = statistics.streams;
    // 300 frames; six or more in a row are lost with probability 1e-10.
    assert_eq!((colour.images + colour.refused, depth.images + depth.refused), (300, 300));
    assert_eq!((colour.refused, depth.refused, statistics.unpaired), (0, 0, 0));
    // A frame of 242 packets is whole with probability 0.98^242 = 0.75 %, so at most 9 of 300 in all but one of a thousand runs.
    assert!(depth.masked >= 291, "{depth:?}");
    // 2 % of 72,600 packets, and four deviations of 38.
    assert!(depth.lost.abs_diff(1452) < 150, "{depth:?}");
    // A fortieth of the frames may lie between two polls.
    assert!(statistics.frames >= 299, "{statistics:?}");
}

#[test]
fn ten_seconds_with_packets_cut_as_well() {
    let statistics = soak(10, PacketFaults { loss: 0.02, cut: 0.01 });
    assert!(statistics.frames >= 290, "{statistics:?}");
    // 1 % of 98 % of 72,600, and four deviations of 27.
    assert!(statistics.streams[1].malformed.abs_diff(711) < 110, "{statistics:?}");
}

#[test]
fn heavy_loss_gives_frames_up_and_never_mixes_them() {
    let statistics = soak(5, PacketFaults { loss: 0.3, cut: 0.02 });
    let [colour, depth] = statistics.streams;
    // Six or more in a row begin at one packet in 2000: in one image in ten.
    assert!(colour.refused > 0 && depth.refused > 0 && statistics.frames > 50, "{statistics:?}");
}

/// The foot at the end of a cable.
struct FootCable(Arc<Mutex<Foot>>);

impl Transport for FootCable {
    fn write(&mut self, request: u8, value: u16, _: u16, _: &[u8]) -> Result<(), TransportError> {
        if self.0.lock().unwrap().take(request, value) { Ok(()) } else { Err(TransportError::Refused) }
    }

    fn read(&mut self, request: u8, _: u16, _: u16, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let state = self.0.lock().unwrap().give(request).ok_or(TransportError::Refused)?;
        buffer[..state.len()].copy_from_slice(&state);
        Ok(state.len())
    }

    fn start(&mut self, _: Box<dyn bench_kinect::usb::Packets>) -> Result<(), TransportError> {
        Err(TransportError::Refused)
    }

    fn stop(&mut self) {}
}

#[test]
fn the_motor_tilts_and_the_accelerometer_shows_it() {
    let bench = Bench::new(PacketFaults::default());
    let motor = Motor::new(Box::new(FootCable(Arc::default())));
    let cable = Box::new(bench.cable.clone());
    let mut kinect = Kinect::new(cable, Some(motor), Model::Xbox1414, "A0".to_owned()).unwrap();
    let motor = kinect.motor().unwrap();
    motor.set_led(Led::Red).unwrap();
    motor.tilt(-10.0).unwrap();
    let attitude = motor.attitude().unwrap();
    assert_eq!(attitude.tilt_deg, Some(-10.0));
    let [_, up, ahead] = attitude.acceleration_m_s2;
    // Half a count of 819 a g is 6 mm/s^2, which is 0.04 degrees.
    assert!((ahead.atan2(up).to_degrees() + 10.0).abs() < 0.1);
    assert!(matches!(motor.tilt(45.0), Err(DriverError::OutOfRange { .. })));

    // The lamp says whether it streams.
    let lamp = Arc::new(Mutex::new(Foot::default()));
    let motor = Motor::new(Box::new(FootCable(Arc::clone(&lamp))));
    let kinect = Kinect::new(Box::new(bench.cable.clone()), Some(motor), Model::Xbox1414, "A0".to_owned());
    let streaming = kinect.unwrap().stream(Settings::default(), || Time::ZERO).unwrap();
    assert!(lamp.lock().unwrap().shows(Led::Green));
    drop(streaming);
    assert!(lamp.lock().unwrap().shows(Led::BlinkGreen));

    let words = bench.open().motor().err().unwrap().to_string();
    assert!(words.contains("not found beside its camera"), "{words}");
    let camera = Camera::new(Model::Xbox1473, Blocks::of(&depth()));
    let cable = Cable::new(camera, PacketFaults::default(), 0);
    let mut kinect = Kinect::new(Box::new(cable), None, Model::Xbox1473, "0".to_owned()).unwrap();
    let words = kinect.motor().err().unwrap().to_string();
    assert!(words.contains("1473") && words.contains("firmware"), "{words}");
}
