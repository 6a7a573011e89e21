//! Products of matrices that lie in slices with strides, by the `gemm` crate on the calling thread.

#![expect(unsafe_code, reason = "the matrix product of the `gemm` crate takes pointers")]

/// A matrix whose value (row, column) is at offset + row·`row_step` + column·`column_step`.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    data: &'a [f32],
    rows: usize,
    columns: usize,
    row_step: usize,
    column_step: usize,
}

impl<'a> View<'a> {
    /// Names `rows` rows of `columns` values, `stride` apart.
    pub(super) fn new(data: &'a [f32], rows: usize, columns: usize, stride: usize) -> Self {
        assert!(rows == 0 || columns == 0 || (rows - 1) * stride + columns <= data.len(), "the view leaves its data");
        Self { data, rows, columns, row_step: stride, column_step: 1 }
    }

    /// Names all rows of `columns` values.
    pub(super) fn all(data: &'a [f32], columns: usize) -> Self {
        Self::new(data, data.len() / columns, columns, columns)
    }

    /// Swaps rows and columns.
    pub(super) fn turned(self) -> Self {
        let Self { data, rows, columns, row_step, column_step } = self;
        Self { data, rows: columns, columns: rows, row_step: column_step, column_step: row_step }
    }
}

/// Computes out = keep·out + a·b, where row r of the result begins at r·`stride` of `out`.
pub(super) fn multiply(out: &mut [f32], stride: usize, keep: bool, a: View<'_>, b: View<'_>) {
    let (rows, columns, depth) = (a.rows, b.columns, a.columns);
    assert_eq!(depth, b.rows, "the matrices do not fit");
    if rows == 0 || columns == 0 {
        return;
    }
    assert!((rows - 1) * stride + columns <= out.len() && columns <= stride, "the result leaves its slice");
    let step = usize::cast_signed;
    // SAFETY: every index of the three matrices lies inside its slice, as was asserted here and by `View::new`;
    // the result is borrowed mutably and so overlaps neither factor.
    unsafe {
        gemm::gemm(
            rows,
            columns,
            depth,
            out.as_mut_ptr(),
            1,
            step(stride),
            keep,
            a.data.as_ptr(),
            step(a.column_step),
            step(a.row_step),
            b.data.as_ptr(),
            step(b.column_step),
            step(b.row_step),
            if keep { 1.0 } else { 0.0 },
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}
