use std::fmt;

/// One channel's loop from output to input: voltage read = gain x voltage set + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelLoop {
    /// Gain, 1 for a perfect channel.
    pub gain: f64,
    /// Offset, V.
    pub offset_v: f64,
    /// Largest distance of a measurement from the line, V.
    pub residual_v: f64,
}

impl ChannelLoop {
    /// A perfect channel.
    pub const IDENTITY: Self = Self { gain: 1.0, offset_v: 0.0, residual_v: 0.0 };

    /// The line of least squares through voltages set and read; `None` for fewer than two different levels.
    pub fn fit(points: &[(f64, f64)]) -> Option<Self> {
        let n = points.len() as f64;
        let mean_set = points.iter().map(|(set, _)| set).sum::<f64>() / n;
        let mean_read = points.iter().map(|(_, read)| read).sum::<f64>() / n;
        let spread: f64 = points.iter().map(|(set, _)| (set - mean_set).powi(2)).sum();
        if points.len() < 2 || spread <= 0.0 {
            return None;
        }
        let gain =
            points.iter().map(|(set, read)| (set - mean_set) * (read - mean_read)).sum::<f64>() / spread;
        let offset_v = mean_read - gain * mean_set;
        let residual_v =
            points.iter().map(|(set, read)| (read - gain * set - offset_v).abs()).fold(0.0, f64::max);
        Some(Self { gain, offset_v, residual_v })
    }

    /// What to set so that `wanted_v` is read. The input is the reference: the PSoC5's delta-sigma converter is true to 0.2 %, its
    /// voltage DACs to a few percent.
    pub fn to_set(&self, wanted_v: f64) -> f64 {
        (wanted_v - self.offset_v) / self.gain
    }
}

/// The loops of throttle, pitch, roll, yaw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration(pub [ChannelLoop; 4]);

impl Calibration {
    /// Perfect channels.
    pub const IDENTITY: Self = Self([ChannelLoop::IDENTITY; 4]);
}

impl fmt::Display for Calibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (name, channel)) in crate::psoc5::CHANNELS.into_iter().zip(self.0).enumerate() {
            let comma = if i > 0 { ", " } else { "" };
            write!(f, "{comma}{name} x {:.4} {:+.1} mV", channel.gain, channel.offset_v * 1e3)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_through_the_measurements_is_found_and_undone() {
        let points = [0.2, 0.8, 1.6, 3.2].map(|set| (set, 0.985 * set + 0.009));
        let channel = ChannelLoop::fit(&points).unwrap();
        assert!((channel.gain - 0.985).abs() < 1e-12 && (channel.offset_v - 0.009).abs() < 1e-12);
        assert!(channel.residual_v < 1e-12);
        assert!((0.985 * channel.to_set(1.9) + 0.009 - 1.9).abs() < 1e-12);
        assert_eq!(ChannelLoop::fit(&[(1.0, 1.0)]), None);
        assert_eq!(ChannelLoop::fit(&[(1.0, 1.0), (1.0, 1.1)]), None);
    }
}
