use bench_recording::{Record, Recorder};

/// Takes what the loop has to say: a recording on disk, or memory.
pub trait Sink {
    /// Takes one record. A recorder's sink never allocates.
    fn take(&mut self, record: Record);
}

impl Sink for Recorder {
    fn take(&mut self, record: Record) {
        self.record(record);
    }
}

/// For tests and for flights that are analysed at once and thrown away.
impl Sink for Vec<Record> {
    fn take(&mut self, record: Record) {
        self.push(record);
    }
}

/// For flights of which nothing but the summary is wanted.
impl Sink for () {
    fn take(&mut self, _record: Record) {}
}
