//! The figures as CSV.

use std::fmt::Write;

use super::Tried;
use super::solver_log::Followed;
use crate::quote::csv;

/// One row a point.
pub fn points(tables: &[Tried]) -> String {
    let mut text = String::from(
        "table,preset,basis,block,ratio,sigma,quality,bytes,log_rms,log_max,render_psnr_db,encode_seconds,\
         decode_seconds,solves,iterations,missed_sigma,series,command\n",
    );
    for tried in tables {
        for p in &tried.points {
            let psnr = p.psnr.map(|db| db.to_string()).unwrap_or_default();
            let series = tried.plan.series.iter().filter(|s| s.settings.contains(&p.settings));
            let series = series.map(|s| s.name.as_str()).collect::<Vec<_>>().join("; ");
            let _ = writeln!(
                text,
                "{},{},{},{},{},{},{},{},{},{},{},{:.6},{:.6},{},{},{},{},{}",
                csv(&tried.name),
                p.preset,
                p.basis,
                p.block,
                p.ratio,
                p.sigma,
                p.quality,
                p.bytes,
                p.log_rms,
                p.log_max,
                psnr,
                p.encode_seconds,
                p.decode_seconds,
                p.solves,
                p.iterations,
                p.missed,
                csv(&series),
                csv(&p.command)
            );
        }
    }
    text
}

/// One row an iterate of a followed solve.
pub fn traces(tables: &[Tried]) -> String {
    let mut text = String::from(
        "table,block,kind,log_range,settings,component,samples,sigma,reached,iterations,transforms,seconds,\
         residual,gap\n",
    );
    for tried in tables {
        for Followed { block, settings, traces } in &tried.followed {
            for (component, trace) in traces.iter().enumerate() {
                for step in &trace.steps {
                    let _ = writeln!(
                        text,
                        "{},{},{},{:.4},{},{component},{},{},{},{},{},{:.7},{:e},{:e}",
                        csv(&tried.name),
                        block.number,
                        block.kind,
                        block.range,
                        csv(settings),
                        trace.samples,
                        trace.sigma,
                        trace.reached,
                        step.iterations,
                        step.transforms,
                        step.seconds,
                        step.residual,
                        step.gap
                    );
                }
            }
        }
    }
    text
}
