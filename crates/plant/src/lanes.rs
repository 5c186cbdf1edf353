//! Numbers that a law of motion computes with: one of them, or one for each of several airframes, a lane each.
//!
//! Each operation is that of IEEE 754 on each lane and none is merged with another, so that a lane holds what the number alone would.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

/// What equations may do with a number. There is no choice among equations but by value, for lanes may choose differently.
pub(crate) trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Mul<f64, Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// A constant, of the kind that this number is.
    fn constant(self, value: f64) -> Self;

    /// The square root.
    fn sqrt(self) -> Self;

    /// The larger one; the bound where this is not a number.
    fn at_least(self, bound: Self) -> Self;

    /// The nearest one from `low` to `high`.
    fn within(self, low: Self, high: Self) -> Self;

    /// What `then` gives where this is below the bound, and nothing elsewhere.
    fn below(self, bound: Self, then: impl FnOnce() -> Self) -> Self;

    /// The reciprocal.
    #[inline(always)]
    fn recip(self) -> Self {
        self.constant(1.0) / self
    }
}

impl Real for f64 {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn at_least(self, bound: Self) -> Self {
        if self > bound { self } else { bound }
    }

    #[inline(always)]
    fn within(self, low: Self, high: Self) -> Self {
        if self < low {
            low
        } else if self > high {
            high
        } else {
            self
        }
    }

    #[inline(always)]
    fn below(self, bound: Self, then: impl FnOnce() -> Self) -> Self {
        // A branch that processors foresee: where it is not taken, nothing waits for what is behind it.
        if self < bound { then() } else { 0.0 }
    }
}

/// As many numbers as the processor computes with at once.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd> {
    simd: S,
    values: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// The lanes at a place of a row whose length is a multiple of theirs.
    #[inline(always)]
    pub(crate) fn load(simd: S, row: &[f64], place: usize) -> Self {
        Self { simd, values: S::as_simd_f64s(row).0[place] }
    }

    /// Puts the lanes at a place of such a row.
    #[inline(always)]
    pub(crate) fn store(self, row: &mut [f64], place: usize) {
        S::as_mut_simd_f64s(row).0[place] = self.values;
    }

    /// Whether any lane is at or below the bound.
    #[inline(always)]
    pub(crate) fn any_at_most(self, bound: f64) -> bool {
        let within = self.simd.less_than_or_equal_f64s(self.values, self.simd.splat_f64s(bound));
        self.simd.first_true_m64s(within) < S::F64_LANES
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { values: self.simd.add_f64s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { values: self.simd.sub_f64s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { values: self.simd.mul_f64s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Mul<f64> for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self * self.constant(factor)
    }
}

impl<S: Simd> Div for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self { values: self.simd.div_f64s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { values: self.simd.neg_f64s(self.values), ..self }
    }
}

impl<S: Simd> Real for Lanes<S> {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self { values: self.simd.splat_f64s(value), ..self }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self { values: self.simd.sqrt_f64s(self.values), ..self }
    }

    #[inline(always)]
    fn at_least(self, bound: Self) -> Self {
        let above = self.simd.greater_than_f64s(self.values, bound.values);
        Self { values: self.simd.select_f64s(above, self.values, bound.values), ..self }
    }

    #[inline(always)]
    fn within(self, low: Self, high: Self) -> Self {
        let above = self.simd.greater_than_f64s(self.values, high.values);
        let values = self.simd.select_f64s(above, high.values, self.values);
        let below = self.simd.less_than_f64s(self.values, low.values);
        Self { values: self.simd.select_f64s(below, low.values, values), ..self }
    }

    #[inline(always)]
    fn below(self, bound: Self, then: impl FnOnce() -> Self) -> Self {
        let is_below = self.simd.less_than_f64s(self.values, bound.values);
        let nothing = self.simd.splat_f64s(0.0);
        Self { values: self.simd.select_f64s(is_below, then().values, nothing), ..self }
    }
}
