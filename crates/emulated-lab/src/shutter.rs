use std::sync::{
    Arc, Mutex, PoisonError,
    mpsc::{Receiver, SyncSender, TrySendError, sync_channel},
};

use bench_kinect::Frame;

/// Frames that wait to be sent, at most; more than one waits only where the host is too slow.
const WAITING: usize = 2;

/// Hands each frame to every stream of every camera that is plugged in.
#[derive(Clone, Default)]
pub struct Shutter(Arc<Mutex<Vec<SyncSender<Arc<Frame>>>>>);

impl Shutter {
    /// Frames from now on.
    pub fn subscribe(&self) -> Receiver<Arc<Frame>> {
        let (sender, receiver) = sync_channel(WAITING);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(sender);
        receiver
    }

    /// A frame is there. A stream that is behind misses it, as in a camera.
    pub fn release(&self, frame: &Arc<Frame>) {
        let mut streams = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        streams.retain(|stream| {
            !matches!(stream.try_send(Arc::clone(frame)), Err(TrySendError::Disconnected(_)))
        });
    }
}
