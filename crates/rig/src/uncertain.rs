/// A number with its one-sigma tolerance: `0.015` or `{ value = 0.015, sigma = 0.00015 }` in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Uncertain {
    /// The nominal value.
    pub value: f64,
    /// One standard deviation, in the value's unit; zero when the number is taken as exact.
    pub sigma: f64,
}

impl Uncertain {
    /// A number taken as exact.
    pub const fn exact(value: f64) -> Self {
        Self { value, sigma: 0.0 }
    }
}
