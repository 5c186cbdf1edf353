//! What stands for who watches, in a program that was built without the live page.

use bench_kinect::{
    Frame,
    track::{Sighting, Tracker},
};
use bench_recording::{Finished, RecordingError};
use bench_rig::{Calibration, Mission, Rig};
use bench_run::{Directive, Watcher};

use super::Arguments;
use crate::flight::Flight;

/// There is nobody.
pub enum Watched {}

impl Watched {
    /// None; an error if the page is wanted.
    pub fn open(arguments: &Arguments, _: &Rig, _: &Mission) -> anyhow::Result<Option<Self>> {
        arguments.live.refuse().map(|()| None)
    }

    pub fn started(self, _: &Mission) -> Result<(Self, Mission, Vec<String>), String> {
        match self {}
    }

    pub fn watcher(&mut self) -> Option<Watcher> {
        match *self {}
    }

    pub fn frames(&self, _: &Calibration) -> anyhow::Result<Self> {
        match *self {}
    }

    pub fn see(&mut self, _: &Frame, _: &Tracker, _: &Sighting) {
        match *self {}
    }

    pub fn asks(&mut self) -> Directive {
        match *self {}
    }

    pub fn landed(self, _: &Flight<'_>, _: &Result<Finished, RecordingError>) {
        match self {}
    }
}
