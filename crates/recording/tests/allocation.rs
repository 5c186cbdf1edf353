//! Handing a record over allocates nothing.

// SAFETY of the allocator below: it only counts, and passes every call on to the system's allocator unchanged.
#![allow(unsafe_code, reason = "a global allocator cannot be had without")]

mod common;

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
};

use bench_recording::{Options, Recorder};
use common::{flight, session};
use tempfile::tempdir;

thread_local! {
    /// Allocations of this thread alone: the writer's thread may allocate.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to `System` with the arguments it came with, whose contract is the same.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller keeps `alloc`'s contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps `dealloc`'s contract; the pointer came from `System`.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller keeps `realloc`'s contract; the pointer came from `System`.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn recording_allocates_nothing_even_when_the_queue_is_full() {
    let folder = tempdir().unwrap();
    let records = flight(60.0);
    for options in [Options::SIMULATION, Options { queue_capacity: 4, ..Options::REAL_TIME }] {
        let mut recorder = Recorder::create(folder.path().join("count.mcap"), &session(), options).unwrap();
        let before = ALLOCATIONS.get();
        for record in &records {
            recorder.record(*record);
        }
        assert_eq!(ALLOCATIONS.get() - before, 0, "{options:?}");
        recorder.finish().unwrap();
    }
}
