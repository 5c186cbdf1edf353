//! Logs as autopilots write them, for tests.

/// A PX4 log: <https://docs.px4.io/main/en/dev_log/ulog_file_format.html>.
pub struct Ulog(Vec<u8>);

impl Ulog {
    /// A log that holds nothing yet.
    pub fn new() -> Self {
        let mut bytes = b"ULog\x01\x12\x35\x01".to_vec();
        bytes.extend(0_u64.to_le_bytes());
        let mut log = Self(bytes);
        log.message(b'B', &[0; 40]);
        log
    }

    fn message(&mut self, kind: u8, content: &[u8]) {
        self.0.extend(u16::try_from(content.len()).unwrap().to_le_bytes());
        self.0.push(kind);
        self.0.extend(content);
    }

    /// Defines a type of messages, such as `battery_status:uint64_t timestamp;float voltage_v;`.
    pub fn format(&mut self, definition: &str) {
        self.message(b'F', definition.as_bytes());
    }

    /// Announces a topic under the number `id`.
    pub fn subscribe(&mut self, id: u16, instance: u8, name: &str) {
        self.message(b'A', &[&[instance][..], &id.to_le_bytes(), name.as_bytes()].concat());
    }

    /// What the log says of itself.
    pub fn info(&mut self, key: &str, value: &str) {
        let key = format!("char[{}] {key}", value.len());
        let length = u8::try_from(key.len()).unwrap();
        self.message(b'I', &[&[length][..], key.as_bytes(), value.as_bytes()].concat());
    }

    /// A parameter of the autopilot.
    pub fn parameter(&mut self, name: &str, value: f32) {
        let key = format!("float {name}");
        let length = u8::try_from(key.len()).unwrap();
        self.message(b'P', &[&[length][..], key.as_bytes(), &value.to_le_bytes()].concat());
    }

    /// A gap that the logger tells of, ms.
    pub fn dropout(&mut self, milliseconds: u16) {
        self.message(b'O', &milliseconds.to_le_bytes());
    }

    /// A sample; `values` are its bytes after the stamp, which is its first field.
    pub fn data(&mut self, id: u16, micros: u64, values: &[u8]) {
        self.message(b'D', &[&id.to_le_bytes()[..], &micros.to_le_bytes(), values].concat());
    }

    /// The file.
    pub fn bytes(self) -> Vec<u8> {
        self.0
    }
}

/// An `ArduPilot` log: `libraries/AP_Logger/LogStructure.h` of its source.
pub struct Dataflash(Vec<u8>);

impl Dataflash {
    /// A log that has the format of formats.
    pub fn new() -> Self {
        let mut log = Self(Vec::new());
        log.format(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns");
        log
    }

    /// Defines a type of messages.
    pub fn format(&mut self, kind: u8, name: &str, letters: &str, labels: &str) {
        let sizes = letters.bytes().map(|letter| match letter {
            b'b' | b'B' | b'M' => 1,
            b'h' | b'H' | b'c' | b'C' => 2,
            b'q' | b'Q' | b'd' => 8,
            b'N' => 16,
            b'Z' => 64,
            _ => 4,
        });
        let length = 3 + sizes.sum::<u8>();
        let text = |text: &str, width: usize| {
            let mut bytes = text.as_bytes().to_vec();
            bytes.resize(width, 0);
            bytes
        };
        let content = [vec![kind, length], text(name, 4), text(letters, 16), text(labels, 64)].concat();
        self.message(128, &content);
    }

    /// A message.
    pub fn message(&mut self, kind: u8, content: &[u8]) {
        self.0.extend([0xa3, 0x95, kind]);
        self.0.extend(content);
    }

    /// A message that begins with its time.
    pub fn data(&mut self, kind: u8, micros: u64, values: &[u8]) {
        self.message(kind, &[&micros.to_le_bytes()[..], values].concat());
    }

    /// The file.
    pub fn bytes(self) -> Vec<u8> {
        self.0
    }
}

/// Numbers one after another as a log has them.
pub fn floats(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| (*number as f32).to_le_bytes()).collect()
}

/// A field of a blackbox log: its name, whether it is signed, and predictor and encoding in whole frames and in differences.
pub type Packed = (&'static str, bool, [u8; 2], [u8; 2]);

/// A log of Betaflight: <https://betaflight.com/docs/development/Blackbox-Internals>.
pub struct Blackbox {
    bytes: Vec<u8>,
    main: Vec<Packed>,
    /// The last two frames.
    known: [Vec<i64>; 2],
    iteration: i64,
    home: [i64; 2],
}

impl Blackbox {
    /// Every so many iterations one is written whole ...
    const WHOLE_EVERY: i64 = 32;
    /// ... and of so many, one is written at all.
    const OF: i64 = 4;
    const MIN_THROTTLE: i64 = 1070;
    const VBAT_REFERENCE: i64 = 1620;
    const MIN_MOTOR: i64 = 158;

    /// A log of main frames with these fields behind the iteration and the time, in us. `slow` and `gps` name fields of such frames,
    /// all of them signed; the first two of `gps` are counted from the place where the craft was armed.
    pub fn new(main: &[Packed], slow: &[&str], gps: &[&str]) -> Self {
        let head: [Packed; 2] = [("loopIteration", false, [0, 1], [6, 9]), ("time", false, [0, 1], [2, 0])];
        let main: Vec<Packed> = head.iter().chain(main).copied().collect();
        let list = |of: &dyn Fn(&Packed) -> String| main.iter().map(of).collect::<Vec<_>>().join(",");
        let all = |of: &[&str], value: &dyn Fn(usize) -> u8| {
            (0..of.len()).map(|place| value(place).to_string()).collect::<Vec<_>>().join(",")
        };
        let mut lines = vec![
            "Product:Blackbox flight data recorder by Nicholas Sherlock".to_owned(),
            "Data version:2".to_owned(),
            format!("I interval:{}", Self::WHOLE_EVERY),
            format!("P interval:1/{}", Self::OF),
            format!("Field I name:{}", list(&|field| field.0.to_owned())),
            format!("Field I signed:{}", list(&|field| u8::from(field.1).to_string())),
            format!("Field I predictor:{}", list(&|field| field.2[0].to_string())),
            format!("Field I encoding:{}", list(&|field| field.2[1].to_string())),
            format!("Field P predictor:{}", list(&|field| field.3[0].to_string())),
            format!("Field P encoding:{}", list(&|field| field.3[1].to_string())),
        ];
        if !slow.is_empty() {
            lines.push(format!("Field S name:{}", slow.join(",")));
            lines.push(format!("Field S signed:{}", all(slow, &|_| 1)));
            lines.push(format!("Field S predictor:{}", all(slow, &|_| 0)));
            lines.push(format!("Field S encoding:{}", all(slow, &|_| 0)));
        }
        if !gps.is_empty() {
            lines.push("Field H name:GPS_home[0],GPS_home[1]".to_owned());
            lines.push("Field H signed:1,1\nH Field H predictor:0,0\nH Field H encoding:0,0".to_owned());
            lines.push(format!("Field G name:time,{}", gps.join(",")));
            lines.push(format!("Field G signed:0,{}", all(gps, &|_| 1)));
            lines.push(format!("Field G predictor:10,{}", all(gps, &|place| if place < 2 { 7 } else { 0 })));
            lines.push(format!("Field G encoding:1,{}", all(gps, &|_| 0)));
        }
        lines.push("Firmware type:Cleanflight".to_owned());
        lines.push("Firmware revision:Betaflight 2025.12.1 (abcdef) STM32F7X2".to_owned());
        lines.push(format!("minthrottle:{}", Self::MIN_THROTTLE));
        lines.push(format!("vbatref:{}", Self::VBAT_REFERENCE));
        lines.push(format!("motorOutput:{},2047", Self::MIN_MOTOR));
        let head = format!("H {}\n", lines.join("\nH "));
        Self { bytes: head.into_bytes(), main, known: [Vec::new(), Vec::new()], iteration: 0, home: [0; 2] }
    }

    /// A main frame, whole or as a difference, as its turn is.
    pub fn main(&mut self, micros: i64, values: &[i64]) {
        let frame: Vec<i64> = [self.iteration, micros & 0xffff_ffff].iter().chain(values).copied().collect();
        assert_eq!(frame.len(), self.main.len());
        let is_whole = self.iteration % Self::WHOLE_EVERY == 0;
        self.iteration += Self::OF;
        let first_motor = self.main.iter().position(|field| field.0 == "motor[0]");
        let packed: Vec<(i64, u8)> = self
            .main
            .iter()
            .enumerate()
            .map(|(place, field)| {
                let [predictor, encoding] = if is_whole { field.2 } else { field.3 };
                let [last, before] =
                    self.known.each_ref().map(|frame| frame.get(place).copied().unwrap_or(0));
                let predicted = match predictor {
                    0 | 6 => 0,
                    1 => last,
                    2 => 2 * last - before,
                    3 => i64::midpoint(last, before),
                    4 => Self::MIN_THROTTLE,
                    5 => frame[first_motor.unwrap()],
                    8 => 1500,
                    9 => Self::VBAT_REFERENCE,
                    11 => Self::MIN_MOTOR,
                    other => panic!("{other}"),
                };
                // Differences run over as the numbers do.
                (i64::from((frame[place] - predicted) as i32), encoding)
            })
            .collect();
        self.bytes.push(if is_whole { b'I' } else { b'P' });
        pack(&mut self.bytes, &packed);
        self.known =
            if is_whole { [frame.clone(), frame] } else { [frame, std::mem::take(&mut self.known[0])] };
    }

    /// A slow frame.
    pub fn slow(&mut self, values: &[i64]) {
        self.bytes.push(b'S');
        for value in values {
            signed(&mut self.bytes, *value);
        }
    }

    /// Where the craft was armed.
    pub fn home(&mut self, home: [i64; 2]) {
        self.home = home;
        self.bytes.push(b'H');
        for value in home {
            signed(&mut self.bytes, value);
        }
    }

    /// What the receiver said so many us after the last main frame.
    pub fn gps(&mut self, after: u32, values: &[i64]) {
        self.bytes.push(b'G');
        unsigned(&mut self.bytes, after);
        for (place, value) in values.iter().enumerate() {
            signed(&mut self.bytes, value - self.home.get(place).unwrap_or(&0));
        }
    }

    /// An event, by its number and what it says.
    pub fn event(&mut self, event: u8, content: &[u8]) {
        self.bytes.extend([b'E', event]);
        self.bytes.extend(content);
    }

    /// The log so far, without an end.
    pub fn cut(self) -> Vec<u8> {
        self.bytes
    }

    /// The log with its end.
    pub fn bytes(mut self) -> Vec<u8> {
        self.event(255, b"End of log\0");
        self.bytes
    }
}

fn unsigned(bytes: &mut Vec<u8>, mut value: u32) {
    while value > 0x7f {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn signed(bytes: &mut Vec<u8>, value: i64) {
    let value = i32::try_from(value).unwrap();
    unsigned(bytes, (value << 1 ^ value >> 31).cast_unsigned());
}

/// How many bits a signed number needs.
fn bits(value: i64) -> u32 {
    65 - if value < 0 { (!value).leading_zeros() } else { value.leading_zeros() }
}

/// Packs numbers with the encoding of each; those that share a tag stand together.
fn pack(bytes: &mut Vec<u8>, packed: &[(i64, u8)]) {
    let mut rest = packed;
    while let [(value, encoding), ..] = *rest {
        let together = match encoding {
            6 => 8,
            7 => 3,
            8 => 4,
            _ => 1,
        };
        let alike = rest.iter().take(together).take_while(|(_, other)| *other == encoding).count();
        let (group, more) = rest.split_at(alike);
        rest = more;
        let values: Vec<i64> = group.iter().map(|(value, _)| *value).collect();
        match encoding {
            0 => signed(bytes, value),
            1 => unsigned(bytes, value as u32),
            3 => unsigned(bytes, -value as u32 & 0x3fff),
            6 if alike == 1 => signed(bytes, value),
            6 => {
                bytes.push(values.iter().rev().fold(0, |tag, value| tag << 1 | u8::from(*value != 0)));
                values.iter().filter(|value| **value != 0).for_each(|value| signed(bytes, *value));
            }
            7 => pack_three(bytes, values.try_into().unwrap()),
            8 => pack_four(bytes, &values),
            9 => {}
            other => panic!("{other}"),
        }
    }
}

fn pack_three(bytes: &mut Vec<u8>, values: [i64; 3]) {
    let [a, b, c] = values.map(|value| value as u8);
    match values.map(bits).into_iter().max().unwrap() {
        ..=2 => bytes.push((a & 3) << 4 | (b & 3) << 2 | c & 3),
        3..=4 => bytes.extend([0x40 | a & 0xf, b << 4 | c & 0xf]),
        5..=6 => bytes.extend([0x80 | a & 0x3f, b & 0x3f, c & 0x3f]),
        _ => {
            let sizes = values.map(|value| (bits(value).div_ceil(8)) as u8);
            bytes.push(0xc0 | (sizes[2] - 1) << 4 | (sizes[1] - 1) << 2 | (sizes[0] - 1));
            for (value, size) in values.into_iter().zip(sizes) {
                bytes.extend(&value.to_le_bytes()[..usize::from(size)]);
            }
        }
    }
}

fn pack_four(bytes: &mut Vec<u8>, values: &[i64]) {
    let mut values = values.to_vec();
    values.resize(4, 0);
    let kinds = values.iter().map(|value| match (*value, bits(*value)) {
        (0, _) => 0,
        (_, ..=4) => 1,
        (_, ..=8) => 2,
        _ => 3_u8,
    });
    let kinds: Vec<u8> = kinds.collect();
    bytes.push(kinds.iter().rev().fold(0, |tag, kind| tag << 2 | kind));
    let mut halves = Vec::new();
    for (value, kind) in values.iter().zip(kinds) {
        let count = [0, 1, 2, 4][usize::from(kind)];
        halves.extend((0..count).rev().map(|half| (value >> (4 * half)) as u8 & 0xf));
    }
    bytes.extend(halves.chunks(2).map(|pair| pair[0] << 4 | pair.get(1).unwrap_or(&0)));
}

/// A log of a Crazyflie's card: one event with variables, by name and Python's letter of their type.
pub struct Crazyflie(Vec<u8>, u8);

impl Crazyflie {
    /// A log of version 1 (stamps in ms) or 2 (in us), with events by name.
    pub fn new(version: u8, events: &[(&str, &[(&str, char)])]) -> Self {
        let mut bytes = vec![0xbc, version, 0];
        bytes.extend(u16::try_from(events.len()).unwrap().to_le_bytes());
        for (id, (name, variables)) in (10_u16..).zip(events) {
            bytes.extend(id.to_le_bytes());
            bytes.extend([name.as_bytes(), &[0]].concat());
            bytes.extend(u16::try_from(variables.len()).unwrap().to_le_bytes());
            for (name, letter) in *variables {
                bytes.extend(format!("{name}({letter})\0").as_bytes());
            }
        }
        Self(bytes, version)
    }

    /// An event, counted from zero as they were named; `values` are the bytes of its variables.
    pub fn data(&mut self, event: u16, micros: u64, values: &[u8]) {
        self.0.extend((event + 10).to_le_bytes());
        if self.1 == 1 {
            self.0.extend(u32::try_from(micros / 1000).unwrap().to_le_bytes());
        } else {
            self.0.extend(micros.to_le_bytes());
        }
        self.0.extend(values);
    }

    /// The log so far, without its checksum.
    pub fn cut(self) -> Vec<u8> {
        self.0
    }

    /// The log with its checksum.
    pub fn bytes(mut self) -> Vec<u8> {
        let sum = crc32fast::hash(&self.0);
        self.0.extend(sum.to_le_bytes());
        self.0
    }
}
