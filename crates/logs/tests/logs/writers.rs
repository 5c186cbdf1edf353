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
