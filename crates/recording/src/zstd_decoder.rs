//! zstd for MCAP's reader. The reader's own switches on zstd's default features with it: decoders of formats older than zstd 1.0
//! and the training of dictionaries, which took longer to compile than all the rest of zstd.

use mcap::{
    McapError, McapResult,
    sans_io::decompressor::{DecompressResult, Decompressor},
};
use zstd::stream::raw::{Decoder, Operation};

/// Decompresses chunks named `zstd`; allocates with the first one.
#[derive(Default)]
pub(crate) struct ZstdDecoder(Option<Decoder<'static>>);

fn failed(error: impl std::fmt::Display) -> McapError {
    McapError::DecompressionError(error.to_string())
}

impl Decompressor for ZstdDecoder {
    fn next_read_size(&self) -> usize {
        0
    }

    fn decompress(&mut self, src: &[u8], dst: &mut [u8]) -> McapResult<DecompressResult> {
        let decoder = match &mut self.0 {
            Some(decoder) => decoder,
            none => none.insert(Decoder::new().map_err(failed)?),
        };
        let done = decoder.run_on_buffers(src, dst).map_err(failed)?;
        Ok(DecompressResult { consumed: done.bytes_read, wrote: done.bytes_written })
    }

    fn reset(&mut self) -> McapResult<()> {
        self.0.as_mut().map_or(Ok(()), |decoder| decoder.reinit().map_err(failed))
    }

    fn name(&self) -> &'static str {
        "zstd"
    }
}
