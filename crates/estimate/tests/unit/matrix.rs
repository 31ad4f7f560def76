use super::*;

#[test]
fn inverse_times_matrix_is_the_identity() {
    let mut a = Symmetric::diagonal(&[2.0, 3.0, 0.5, 1e-4]);
    a.add_outer(1.5, &[0.3, -1.0, 0.2, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let factor = a.cholesky().expect("positive definite");
    let inverse = factor.inverse();
    for j in 0..4 {
        let mut column = [0.0; MAX_STATES];
        (0..4).for_each(|i| column[i] = inverse.get(i, j));
        for (i, value) in a.times(&column).iter().enumerate().take(4) {
            let expected = f64::from(u8::from(i == j));
            assert!((value - expected).abs() < 1e-12, "{i} {j}: {value}");
        }
    }
}

#[test]
fn held_entries_keep_their_value_and_the_others_solve_the_rest() {
    let mut a = Symmetric::diagonal(&[2.0, 3.0, 0.5]);
    a.add_outer(1.5, &[0.3, -1.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let (mut b, mut held) = ([0.0; MAX_STATES], [None; MAX_STATES]);
    b[..3].copy_from_slice(&[1.0, -2.0, 0.7]);
    held[1] = Some(0.4);
    let x = a.solve_with(&held, &b).expect("positive definite");
    let product = a.times(&x);
    assert!(x[1] == 0.4 && (product[0] - 1.0).abs() < 1e-12 && (product[2] - 0.7).abs() < 1e-12, "{x:?}");
}

#[test]
fn determinant_of_a_known_matrix_is_exact() {
    let mut a = Symmetric::diagonal(&[1.0, 1.0]);
    a.add_outer(1.0, &[1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]); // [[2, 2], [2, 5]]
    let ln = a.cholesky().expect("positive definite").ln_determinant();
    assert!((ln - 6.0_f64.ln()).abs() < 1e-14);
}

#[test]
fn eigenvalues_of_known_matrices_are_exact() {
    let mut a = Symmetric::diagonal(&[1.0, 1.0]);
    a.add_outer(1.0, &[1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]); // 6 along (1, 2), 1 across
    let mut found = a.eigenvalues()[..2].to_vec();
    found.sort_by(f64::total_cmp);
    assert!((found[0] - 1.0).abs() < 1e-12 && (found[1] - 6.0).abs() < 1e-12, "{found:?}");
    let mut b = Symmetric::diagonal(&[2.0, 3.0, 0.5, 1e-4]);
    b.add_outer(1.5, &[0.3, -1.0, 0.2, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let ln: f64 = b.eigenvalues()[..4].iter().map(|v| v.ln()).sum();
    assert!((ln - b.cholesky().expect("positive definite").ln_determinant()).abs() < 1e-9);
}

#[test]
fn indefinite_or_nan_matrix_has_no_factor() {
    assert!(Symmetric::diagonal(&[1.0, -1.0]).cholesky().is_none());
    assert!(Symmetric::diagonal(&[1.0, f64::NAN]).cholesky().is_none());
}

#[test]
fn tails_agree_with_tables() {
    for (z, tail) in [(0.0, 0.5), (1.0, 0.158_655_253_931), (2.0, 0.022_750_131_948), (5.0, 2.866_515_7e-7)] {
        assert!((upper_tail(z) / tail - 1.0).abs() < 1e-5, "{z}: {}", upper_tail(z));
        assert!((upper_tail(-z) - (1.0 - tail)).abs() < 1e-9);
    }
}

#[test]
fn truncated_normal_has_a_mean_above_the_floor_and_a_smaller_deviation() {
    // At the mean: mean + sigma sqrt(2 / pi), variance sigma^2 (1 - 2 / pi).
    let (mean, sigma) = truncated(40.0, 15.0, 40.0);
    assert!((mean - 40.0 - 15.0 * 0.797_884_56).abs() < 1e-6 && (sigma - 15.0 * 0.602_810_275).abs() < 1e-6);
    let (mean, sigma) = truncated(40.0, 15.0, -200.0);
    assert!((mean - 40.0).abs() < 1e-6 && (sigma - 15.0).abs() < 1e-6);
    let (mean, sigma) = truncated(0.0, 1.0, 12.0);
    assert!(mean > 12.0 && mean < 12.1 && sigma > 0.0 && sigma < 0.1);
}

#[test]
fn chi_squared_quantiles_agree_with_tables() {
    for (degrees, z, expected) in
        [(1, 1.959_964, 5.023_9), (3, 1.959_964, 9.348_4), (10, -1.959_964, 3.246_97)]
    {
        let found = chi_squared_quantile(degrees, z);
        assert!((found / expected - 1.0).abs() < 0.03, "{degrees}: {found}");
    }
}
