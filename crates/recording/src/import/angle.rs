//! Angles of quaternions.

/// An angle of a quaternion from the body's frame (x ahead, y right, z down) to the earth's (z down), rad.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Angle {
    Roll,
    Pitch,
    Yaw,
}

impl Angle {
    pub const ALL: [(&str, Self); 3] = [(".roll", Self::Roll), (".pitch", Self::Pitch), (".yaw", Self::Yaw)];

    /// Tait-Bryan angles, first about z, then y, then x; `w` is the real part. The length of the quaternion does not matter.
    pub fn of(self, [w, x, y, z]: [f64; 4]) -> f64 {
        let square = w * w + x * x + y * y + z * z;
        match self {
            Self::Roll => (w * x + y * z).atan2(0.5 * square - (x * x + y * y)),
            Self::Pitch => (2.0 * (w * y - z * x) / square).clamp(-1.0, 1.0).asin(),
            Self::Yaw => (w * z + x * y).atan2(0.5 * square - (y * y + z * z)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_of_a_quaternion_are_those_it_was_made_of() {
        let (roll, pitch, yaw) = (0.3_f64, -0.4_f64, 2.5_f64);
        let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|angle| (angle / 2.0).sin_cos());
        let q = [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ];
        for q in [q, q.map(|part| part * -1.01)] {
            for (angle, expected) in [(Angle::Roll, roll), (Angle::Pitch, pitch), (Angle::Yaw, yaw)] {
                assert!((angle.of(q) - expected).abs() < 1e-12, "{angle:?}: {}", angle.of(q));
            }
        }
    }
}
