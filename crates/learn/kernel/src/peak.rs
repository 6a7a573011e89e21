//! The yardstick: the product of square matrices by the `gemm` crate, which a benchmark times beside the networks.

#![expect(unsafe_code, reason = "the matrix product of the `gemm` crate takes pointers")]

/// Two square matrices and their product.
pub struct Yardstick {
    side: usize,
    a: Vec<f32>,
    b: Vec<f32>,
    product: Vec<f32>,
}

impl Yardstick {
    /// Makes matrices of a side.
    #[must_use]
    pub fn new(side: usize) -> Self {
        let values = |period: usize| (0..side * side).map(|i| (i % period) as f32 - 2.0).collect();
        Self { side, a: values(7), b: values(5), product: vec![0.0; side * side] }
    }

    /// Returns the floating-point operations of one product.
    #[must_use]
    pub fn operations(&self) -> f64 {
        2.0 * (self.side as f64).powi(3)
    }

    /// Multiplies once and returns the first value.
    pub fn run(&mut self, threads: usize) -> f32 {
        let parallelism = if threads > 1 { gemm::Parallelism::Rayon(threads) } else { gemm::Parallelism::None };
        let (side, row) = (self.side, self.side.cast_signed());
        let (product, a, b) = (self.product.as_mut_ptr(), self.a.as_ptr(), self.b.as_ptr());
        // SAFETY: the three buffers hold side·side values each and do not overlap; strides stay inside them.
        unsafe {
            gemm::gemm(
                side,
                side,
                side,
                product,
                1,
                row,
                false,
                a,
                1,
                row,
                b,
                1,
                row,
                0.0,
                1.0,
                false,
                false,
                false,
                parallelism,
            );
        }
        self.product[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_yardstick_multiplies() {
        let mut yardstick = Yardstick::new(40);
        let expected: f32 = (0..40).map(|k| yardstick.a[k] * yardstick.b[40 * k]).sum();
        assert_eq!(yardstick.run(1), expected);
        assert_eq!(yardstick.run(2), expected);
        assert_eq!(yardstick.operations(), 128_000.0);
    }
}
