//! Bursts: stretches of time in which several joints at once have far larger residuals than elsewhere.

use crate::fit::search::Search;
use crate::policy::POLICY;

/// Rows are averaged over this \[s\].
const SMOOTH_S: f64 = 0.1;
/// A burst is widened by this on both sides \[s\].
const MARGIN_S: f64 = 0.15;
/// Rounds of trimming.
const TRIMMINGS: usize = 6;
/// Share of the blocks that values are told by.
const CALM_BLOCK_SHARE: f64 = 0.4;
/// Scale of the nominal's errors while trimming.
const TRIM_SCALE: f64 = 0.5;

/// From and to, in seconds since the run's first sample, for each run.
pub(crate) fn find(search: &Search<'_>) -> Option<Vec<Vec<(f64, f64)>>> {
    let joints = search.noise.len();
    let background = &search.design.background;
    let blocks = background.blocks();
    let mut kept: Vec<usize> = (0..blocks).collect();
    let mut weights = search.weights.clone();
    let mut found = None;
    // Least trimmed squares: contact must not bend the values that it is told by.
    for _ in 0..TRIMMINGS {
        let solved = background.solve(&weights, TRIM_SCALE, &kept)?;
        let residuals = search.design.residuals(&solved.x, &solved.stretches);
        let usual: Vec<f64> = (0..joints)
            .map(|j| {
                let mut size: Vec<f64> = residuals.iter().flat_map(|r| r[j].iter().map(|e| e.abs())).collect();
                size.sort_by(f64::total_cmp);
                (size.get(size.len() / 2).copied().unwrap_or(0.0) / 0.6745).max(search.floor[j]).max(1e-9)
            })
            .collect();
        weights = usual.iter().map(|u| 1.0 / (u * u)).collect();
        let mut errors: Vec<(f64, usize)> = (0..blocks).map(|b| (background.error(&weights, b, &solved), b)).collect();
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        kept = errors.iter().take((blocks as f64 * CALM_BLOCK_SHARE).ceil() as usize).map(|e| e.1).collect();
        found = Some((residuals, usual));
    }
    let (residuals, usual) = found?;
    let each = |(r, run): (usize, &&crate::screen::prepared::Prepared)| {
        let period = run.chain.row_period_s;
        let rows = run.rows();
        let power = |j: usize, k: usize| (residuals[r][j][k] / usual[j]).powi(2);
        let half = (0.5 * SMOOTH_S / period).round() as usize;
        let mut windows: Vec<(f64, f64)> = Vec::new();
        for k in 0..rows {
            let around = k.saturating_sub(half)..(k + half + 1).min(rows);
            let mean = |j: usize| around.clone().map(|k| power(j, k)).sum::<f64>() / around.len() as f64;
            let joint_powers: Vec<f64> = (0..joints).map(mean).collect();
            let felt = joint_powers.iter().filter(|p| **p > POLICY.signal_faults.min_joint_burst_power).count();
            let t = run.chain.sample_of(k) as f64 * run.run.period_s;
            let inside =
                t > POLICY.signal_faults.burst_edge_s && t < run.run.seconds() - POLICY.signal_faults.burst_edge_s;
            if joint_powers.iter().sum::<f64>() / joints as f64 <= POLICY.signal_faults.min_burst_power
                || felt < 2.min(joints)
                || !inside
            {
                continue;
            }
            match windows.last_mut() {
                Some(last) if t - last.1 < POLICY.signal_faults.max_burst_pause_s + 2.0 * MARGIN_S => {
                    last.1 = t + MARGIN_S;
                }
                _ => windows.push((t - MARGIN_S, t + MARGIN_S)),
            }
        }
        let total: f64 = windows.iter().map(|(a, b)| b - a).sum();
        if total > POLICY.signal_faults.max_burst_time_share * run.run.seconds() { Vec::new() } else { windows }
    };
    Some(search.runs.iter().enumerate().map(each).collect())
}
