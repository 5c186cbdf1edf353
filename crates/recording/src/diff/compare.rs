//! The second pass: both recordings at once, in order of time, each sample against the other recording.

use std::{
    sync::{
        Arc,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    thread,
};

use super::{
    align::TimeMap,
    law::{Cell, Entry, Extractor, catalogue, slots},
    merge::{Axis, Group, Outcome, Place, Rows, Setup},
    names::Names,
    scan::Scan,
    trace::Stretches,
};
use crate::{Channel, RecordingError};

/// Recordings of more records than this are compared by two threads, half of the fields each.
const SHARED_OUT_FROM: u64 = 20_000;

/// Compares the fields that have a setup; one outcome a slot.
pub(super) fn compare(
    a: &Scan,
    b: &Scan,
    map: &TimeMap,
    setups: &[Option<Setup>],
    axis: Option<Axis>,
) -> Result<Vec<Option<Outcome>>, RecordingError> {
    let b_ends = [b.first_ns, b.last_ns].map(|t_ns| map.place(1, t_ns).map(|(t_ns, _)| t_ns));
    let shared_ns = (
        b_ends[0].map_or(a.first_ns, |t| t.max(a.first_ns)),
        b_ends[1].map_or(a.last_ns, |t| t.min(a.last_ns)),
    );
    let cuts_ns = map.cuts_ns();
    let mut groups: Vec<Group<'_>> = Vec::new();
    for channel in Channel::ALL {
        let first = slots()[channel as usize];
        // Fields that every record of the channel has share a group; others have instants of their own.
        let mut whole = Vec::new();
        for column in 0..channel.fields().len() {
            let slot = first + column;
            let Some(setup) = setups[slot] else { continue };
            let is_whole = a.is_whole(slot) && b.is_whole(slot);
            if is_whole && whole.iter().any(|group: &usize| groups[*group].adopt(column, slot, setup, axis)) {
                continue;
            }
            if is_whole {
                whole.push(groups.len());
            }
            groups.push(Group::new((channel, column, slot), setup, shared_ns, &cuts_ns, axis));
        }
    }
    let mut names = Names::default();
    // A file that is out of order is read once a channel: each for itself is in order, or nothing is.
    if a.is_unsorted() || b.is_unsorted() {
        for of_channel in groups.chunk_by_mut(|one, next| one.channel == next.channel) {
            compare_groups(a, b, (map, axis), of_channel, &mut names)?;
        }
    } else {
        compare_groups(a, b, (map, axis), &mut groups, &mut names)?;
    }
    let mut outcomes: Vec<Option<Outcome>> = setups.iter().map(|_| None).collect();
    for (slot, outcome) in groups.into_iter().flat_map(|group| group.finish(&names)) {
        outcomes[slot] = Some(outcome);
    }
    Ok(outcomes)
}

/// Samples of both recordings in one order of time, by channel. What compares goes through it field by field, so that what is kept
/// of a field stays at hand.
struct Block {
    records: usize,
    rows: [Rows; Channel::ALL.len()],
}

impl Block {
    /// Records of a block.
    const RECORDS: usize = 1024;

    fn new() -> Self {
        Self { records: 0, rows: Default::default() }
    }

    /// Hands the samples to what compares them.
    fn compare<'m, 'a: 'm>(&self, groups: impl IntoIterator<Item = &'m mut Group<'a>>) {
        for group in groups {
            group.take(&self.rows[group.channel as usize]);
        }
    }
}

/// Reads both recordings, each on a thread of its own, and compares the fields of some channels: here, or on two more threads
/// where there is much to compare. Blocks go from here to both, which wait for nothing else.
fn compare_groups(
    a: &Scan,
    b: &Scan,
    (map, axis): (&TimeMap, Option<Axis>),
    groups: &mut [Group<'_>],
    names: &mut Names,
) -> Result<(), RecordingError> {
    let entries = catalogue();
    let mut channels: Vec<Channel> = groups.iter().map(|group| group.channel).collect();
    channels.dedup();
    let plan = Plan { map, stretches: axis.map(Stretches::of) };
    thread::scope(|scope| {
        let receivers = [a, b].map(|scan| {
            let (sender, receiver) = sync_channel(BATCHES);
            let (entries, channels) = (&entries, &channels);
            scope.spawn(move || read_ahead(scan, channels, entries, &sender));
            receiver
        });
        if a.records.max(b.records) < SHARED_OUT_FROM {
            return make_blocks(receivers, &plan, names, |block| block.compare(&mut *groups));
        }
        let senders = halves(groups, a, b).map(|mut groups| {
            let (sender, receiver) = sync_channel::<Arc<Block>>(BLOCKS);
            scope.spawn(move || {
                for block in receiver {
                    block.compare(groups.iter_mut().map(|group| &mut **group));
                }
            });
            sender
        });
        make_blocks(receivers, &plan, names, |block| {
            let block = Arc::new(block);
            for sender in &senders {
                // It fails only where the other end has panicked, which the end of the scope tells.
                let _ = sender.send(Arc::clone(&block));
            }
        })
    })
}

/// The groups in two parts of about as many samples.
fn halves<'m, 'a>(groups: &'m mut [Group<'a>], a: &Scan, b: &Scan) -> [Vec<&'m mut Group<'a>>; 2] {
    let samples = |group: &Group| -> u64 {
        group.slots().map(|slot| a.fields[slot].count + b.fields[slot].count).sum()
    };
    let mut groups: Vec<&mut Group<'_>> = groups.iter_mut().collect();
    groups.sort_by_key(|group| std::cmp::Reverse(samples(group)));
    let mut halves = [(0, Vec::new()), (0, Vec::new())];
    for group in groups {
        let smaller = usize::from(halves[1].0 < halves[0].0);
        halves[smaller].0 += samples(group);
        halves[smaller].1.push(group);
    }
    halves.map(|(_, groups)| groups)
}

/// Records that a thread reads ahead before it waits: so many a batch, and so many batches.
const BATCH: usize = 256;
const BATCHES: usize = 4;
/// Blocks that wait for being compared.
const BLOCKS: usize = 2;

/// Records of one recording in order of time, as numbers.
#[derive(Default)]
struct Batch {
    /// Instant, ns, and channel of each.
    records: Vec<(i64, Channel)>,
    /// The numbers of all fields of one record after those of another; not a number where there is none.
    numbers: Vec<f64>,
    /// Names that no batch before had, with the numbers that stand for them.
    names: Vec<(u64, String)>,
    /// What ended the reading after these records.
    error: Option<RecordingError>,
}

/// Sends the records of a recording in order of time until nobody wants them any more.
fn read_ahead(scan: &Scan, channels: &[Channel], entries: &[Entry], sender: &SyncSender<Batch>) {
    let mut records = match scan.sorted(channels) {
        Ok(records) => records,
        Err(error) => {
            // Nobody is left to tell only if the other recording has failed already.
            let _ = sender.send(Batch { error: Some(error), ..Batch::default() });
            return;
        }
    };
    let mut extractor = Extractor::new();
    let mut names = Names::default();
    loop {
        let mut batch = Batch::default();
        for read in records.by_ref().take(BATCH) {
            let (t_ns, record) = match read {
                Ok(read) => read,
                Err(error) => {
                    batch.error = Some(error);
                    break;
                }
            };
            batch.records.push((t_ns, record.channel()));
            extractor.each(&record, |slot, cell| {
                let Cell::Number(number) = cell else { return batch.numbers.push(f64::NAN) };
                batch.numbers.push(number);
                if entries[slot].law.names
                    && let Some(name) = names.learn(entries, slot, number, &record)
                {
                    batch.names.push((number.to_bits(), name.to_owned()));
                }
            });
        }
        let ends = batch.records.is_empty() || batch.error.is_some();
        if sender.send(batch).is_err() || ends {
            return;
        }
    }
}

/// How blocks are made.
struct Plan<'a> {
    map: &'a TimeMap,
    /// `None` where nothing is drawn.
    stretches: Option<Stretches>,
}

/// Makes blocks of two recordings, until both are at their end.
fn make_blocks(
    receivers: [Receiver<Batch>; 2],
    plan: &Plan,
    names: &mut Names,
    mut take: impl FnMut(Block),
) -> Result<(), RecordingError> {
    let [a, b] = receivers;
    let mut sources = [Ahead::new(a, 0, plan.map, names)?, Ahead::new(b, 1, plan.map, names)?];
    let mut block = Block::new();
    while let Some(side) = earlier(&sources) {
        let Some(head) = sources[side].head.take() else { break };
        let stretch = plan.stretches.zip(head.place).map_or(0, |(stretches, (t_ns, _))| stretches.find(t_ns));
        let rows = &mut block.rows[head.channel as usize];
        rows.places.push(Place { side, at: head.place, stretch });
        rows.numbers.extend_from_slice(sources[side].numbers(head.channel));
        sources[side].advance(&head, names)?;
        block.records += 1;
        if block.records == Block::RECORDS {
            take(std::mem::replace(&mut block, Block::new()));
        }
    }
    take(block);
    Ok(())
}

/// The side whose next record comes first; `None` at the end of both.
fn earlier(sources: &[Ahead<'_>; 2]) -> Option<usize> {
    match (&sources[0].head, &sources[1].head) {
        (Some(a), Some(b)) => Some(usize::from(b.due_ns < a.due_ns)),
        (Some(_), None) => Some(0),
        (None, Some(_)) => Some(1),
        (None, None) => None,
    }
}

/// A recording's records with their places on A's clock.
struct Ahead<'a> {
    receiver: Receiver<Batch>,
    batch: Batch,
    /// The record of the batch that comes next, and where its numbers begin.
    next: usize,
    numbers_from: usize,
    side: usize,
    map: &'a TimeMap,
    head: Option<Head>,
}

/// The record that comes next.
struct Head {
    /// Its place, or that of the record before if it has none, ns.
    due_ns: i64,
    place: Option<(i64, u32)>,
    channel: Channel,
}

impl<'a> Ahead<'a> {
    fn new(
        receiver: Receiver<Batch>,
        side: usize,
        map: &'a TimeMap,
        names: &mut Names,
    ) -> Result<Self, RecordingError> {
        let mut ahead =
            Self { receiver, batch: Batch::default(), next: 0, numbers_from: 0, side, map, head: None };
        ahead.fetch(i64::MIN, names)?;
        Ok(ahead)
    }

    /// The numbers of the next record, which is of this channel.
    fn numbers(&self, channel: Channel) -> &[f64] {
        &self.batch.numbers[self.numbers_from..][..channel.fields().len()]
    }

    /// Goes on to the record after `done`.
    fn advance(&mut self, done: &Head, names: &mut Names) -> Result<(), RecordingError> {
        self.next += 1;
        self.numbers_from += done.channel.fields().len();
        self.fetch(done.due_ns, names)
    }

    fn fetch(&mut self, before_ns: i64, names: &mut Names) -> Result<(), RecordingError> {
        while self.next == self.batch.records.len() {
            if let Some(error) = self.batch.error.take() {
                return Err(error);
            }
            // Nobody sends any more: this is the end.
            let Ok(batch) = self.receiver.recv() else { return Ok(()) };
            (self.batch, self.next, self.numbers_from) = (batch, 0, 0);
            names.add(std::mem::take(&mut self.batch.names));
        }
        let (t_ns, channel) = self.batch.records[self.next];
        let place = self.map.place(self.side, t_ns);
        self.head = Some(Head { due_ns: place.map_or(before_ns, |(t_ns, _)| t_ns), place, channel });
        Ok(())
    }
}
