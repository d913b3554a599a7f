//! `[supervision]`: which directions of the parameter space may move.

use rivet_estimation::{ColumnsSettings, EigenSettings, ReferenceWorkload, Supervision, TrackedSettings};

use crate::reader::Reader;

/// The keys of the other kinds are read and checked as well: a file may keep them while it tries another kind.
pub(crate) fn supervision(reader: &mut Reader<'_>) -> Supervision {
    let kind = reader.text("supervision", "kind");
    let tolerance = reader.number("supervision", "tolerance");
    let hysteresis = reader.number("supervision", "hysteresis");
    let relevance = reader.number("supervision", "relevance");
    let dwell = reader.count("supervision", "dwell") as u32;
    let rounds = reader.count("supervision", "rounds");
    let min_angle = reader.number("supervision", "min_angle");
    let max_condition = reader.number("supervision", "max_condition");
    match kind.as_str() {
        "off" => Supervision::Off,
        "columns" => Supervision::Columns(ColumnsSettings { tolerance, min_angle, max_condition }),
        "eigen" => Supervision::Eigen(EigenSettings { tolerance, hysteresis, relevance }),
        _ => Supervision::Tracked(TrackedSettings {
            tolerance,
            hysteresis,
            relevance,
            dwell,
            rounds,
            ..TrackedSettings::default()
        }),
    }
}

/// What directions are measured by.
pub(crate) fn workload(reader: &mut Reader<'_>) -> ReferenceWorkload {
    match reader.text("supervision", "workload").as_str() {
        "both-ways" => ReferenceWorkload::BothWays,
        _ => ReferenceWorkload::OneWay,
    }
}
