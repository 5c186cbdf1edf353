//! The second pass: both recordings at once, in order of time, each sample against the other recording.

use std::{
    ops::{ControlFlow, Range},
    sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel},
    thread,
};

use super::{
    align::TimeMap,
    law::slots,
    merge::{Axis, Block, Group, Outcome, Place, Setup},
    rows::{Row, Steps},
    scan::Scan,
    trace::Stretches,
};
use crate::{Channel, RecordingError};

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
    let plan = Plan { map, stretches: axis.map(Stretches::of) };
    // A file that is out of order is read once a channel: each for itself is in order, or nothing is.
    if a.is_unsorted() || b.is_unsorted() {
        for of_channel in groups.chunk_by_mut(|one, next| one.channel == next.channel) {
            compare_groups(a, b, plan, of_channel)?;
        }
    } else {
        compare_groups(a, b, plan, &mut groups)?;
    }
    let mut outcomes: Vec<Option<Outcome>> = setups.iter().map(|_| None).collect();
    for (slot, outcome) in groups.into_iter().flat_map(|group| group.finish([&a.names, &b.names])) {
        outcomes[slot] = Some(outcome);
    }
    Ok(outcomes)
}

/// Reads both recordings, each on a thread of its own, and compares the fields of some channels.
fn compare_groups(a: &Scan, b: &Scan, plan: Plan, groups: &mut [Group<'_>]) -> Result<(), RecordingError> {
    let mut channels: Vec<Channel> = groups.iter().map(|group| group.channel).collect();
    channels.dedup();
    thread::scope(|scope| {
        let channels = &channels;
        let (readers, ahead): (Vec<_>, Vec<_>) = [a, b]
            .into_iter()
            .enumerate()
            .map(|(side, scan)| {
                let (sender, receiver) = sync_channel(BATCHES);
                let (giver, used) = channel();
                let ends = (sender, used);
                (scope.spawn(move || read_ahead(scan, side, channels, plan, ends)), (receiver, giver))
            })
            .unzip();
        compare_batches(&ahead, groups);
        drop(ahead);
        readers
            .into_iter()
            .try_for_each(|reader| reader.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    })
}

/// Batches that a thread reads ahead before it waits.
const BATCHES: usize = 2;

/// Where samples belong.
#[derive(Clone, Copy)]
struct Plan<'a> {
    map: &'a TimeMap,
    /// `None` where nothing is drawn.
    stretches: Option<Stretches>,
}

/// Records of one recording in order of time, as numbers, by channel.
struct Batch {
    records: usize,
    blocks: [Block; Channel::ALL.len()],
    /// No record that follows is before this instant on A's clock, ns.
    until_ns: i64,
}

impl Batch {
    fn new() -> Self {
        Self { records: 0, blocks: Channel::ALL.map(Block::new), until_ns: i64::MIN }
    }

    /// Empties the batch, for records that are not before an instant.
    fn begin(&mut self, until_ns: i64) {
        (self.records, self.until_ns) = (0, until_ns);
        self.blocks.iter_mut().for_each(|block| block.places.clear());
    }

    fn push(&mut self, side: usize, plan: Plan, row: &Row) {
        let place = plan.map.place(side, row.t_ns());
        self.until_ns = place.map_or(self.until_ns, |(t_ns, _)| t_ns.max(self.until_ns));
        let stretch = plan.stretches.zip(place).map_or(0, |(stretches, (t_ns, _))| stretches.find(t_ns));
        let (t_ns, piece) = place.map_or((self.until_ns, None), |(t_ns, piece)| (t_ns, Some(piece)));
        self.blocks[row.channel as usize].push(Place { t_ns, piece, stretch }, &row.numbers);
        self.records += 1;
    }
}

/// Sends the records of a recording in order of time until nobody wants them any more.
fn read_ahead(
    scan: &Scan,
    side: usize,
    channels: &[Channel],
    plan: Plan,
    (sender, used): (SyncSender<Batch>, Receiver<Batch>),
) -> Result<(), RecordingError> {
    let mut steps = Steps::new();
    let mut batch = Batch::new();
    scan.sorted(channels, |row| {
        steps.set(row);
        batch.push(side, plan, row);
        if batch.records < Block::ROWS {
            return ControlFlow::Continue(());
        }
        let mut next = used.try_recv().unwrap_or_else(|_| Batch::new());
        next.begin(batch.until_ns);
        match sender.send(std::mem::replace(&mut batch, next)) {
            Ok(()) => ControlFlow::Continue(()),
            Err(_) => ControlFlow::Break(()),
        }
    })?;
    // It fails only where nobody wants it any more.
    let _ = sender.send(batch);
    Ok(())
}

/// Compares the batches of both recordings until they end, and gives them back to be filled again.
fn compare_batches(ahead: &[(Receiver<Batch>, Sender<Batch>)], groups: &mut [Group<'_>]) {
    // An ended recording is one of which there are no more batches.
    let mut batches = [ahead[0].0.recv().ok(), ahead[1].0.recv().ok()];
    let nothing = Batch::new();
    let mut begins = [[0; Channel::ALL.len()]; 2];
    let mut order = Vec::new();
    loop {
        // What comes first of both is done with first. Of equal instants A's come first.
        let side = match &batches {
            [Some(a), Some(b)] => usize::from(b.until_ns < a.until_ns),
            [Some(_), None] => 0,
            [None, Some(_)] => 1,
            [None, None] => return,
        };
        let until_ns = batches[side].as_ref().map_or(i64::MAX, |batch| batch.until_ns);
        let [a, b] = batches.each_ref().map(|batch| batch.as_ref().unwrap_or(&nothing));
        for of_channel in groups.chunk_by_mut(|one, next| one.channel == next.channel) {
            let channel = of_channel[0].channel as usize;
            let blocks = [&a.blocks[channel], &b.blocks[channel]];
            let is_due =
                |of: usize, t_ns: i64| of == side || t_ns < until_ns || (of == 0 && t_ns == until_ns);
            let rows = [0, 1].map(|of| {
                let begin = begins[of][channel];
                let rest = &blocks[of].places[begin..];
                begin..begin + rest.iter().take_while(|place| is_due(of, place.t_ns)).count()
            });
            put_in_order(blocks, &rows, &mut order);
            for group in of_channel {
                group.take(blocks, &rows, &order);
            }
            for of in 0..2 {
                begins[of][channel] = rows[of].end;
            }
        }
        let (receiver, used) = &ahead[side];
        if let Some(done) = std::mem::replace(&mut batches[side], receiver.recv().ok()) {
            // It fails only where all was read, and no batch is needed any more.
            let _ = used.send(done);
        }
        begins[side] = Default::default();
    }
}

/// The sides from which the rows of both come in order of time.
fn put_in_order(blocks: [&Block; 2], rows: &[Range<usize>; 2], order: &mut Vec<usize>) {
    let [a, b] = [0, 1].map(|side| &blocks[side].places[rows[side].clone()]);
    order.clear();
    let mut b = b.iter().peekable();
    for place in a {
        while b.next_if(|other| other.t_ns < place.t_ns).is_some() {
            order.push(1);
        }
        order.push(0);
    }
    order.extend(b.map(|_| 1));
}
