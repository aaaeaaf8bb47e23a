//! The page: everything in one file of HTML, no script, nothing to fetch.

use std::fmt::Write;

use super::figures::{following, precision};
use super::front::pareto_front;
use super::point::{DECODES, Point, anchor};
use super::solver_log::{GAP, RUNS};
use super::style::Style;
use super::{Run, Tried};
use crate::quote::html;
use crate::text::{decibel, error_figure, grouped};

const STYLE: &str = "\
body{font:15px/1.45 sans-serif;color:#222;max-width:1400px;margin:1.5em auto;padding:0 1em}
h2{border-top:2px solid #333;padding-top:.5em;margin-top:2em}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(340px,1fr));gap:.5em}
.four{grid-template-columns:repeat(4,1fr)}
@media(max-width:1200px){.four{grid-template-columns:repeat(2,1fr)}}
.plot{width:100%;max-width:620px;height:auto}
.legend{display:flex;flex-wrap:wrap;gap:.2em 1.4em;font-size:13px;margin:.3em 0}
.legend svg{vertical-align:-2px;margin-right:.4em}
.mark:hover{stroke:#000;stroke-width:2}
.rows{overflow-x:auto}
table{border-collapse:collapse;font-size:13px}
th,td{padding:.15em .6em;text-align:right;white-space:nowrap;border-bottom:1px solid #ddd}
th{text-align:right;background:#f4f4f4}
td.text,th.text{text-align:left}
tr:target{background:#fff2b8}
code{font-size:12px}
";

/// The whole page.
pub fn page(run: &Run, tables: &[Tried]) -> String {
    let names = tables.iter().map(|t| t.name.as_str()).collect::<Vec<_>>().join(", ");
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width\">\n<title>csbrdf report: {}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n",
        html(&names)
    );
    out.push_str(&introduction(run));
    for (number, tried) in tables.iter().enumerate() {
        let _ = writeln!(out, "<h2>{}</h2>", html(&tried.name));
        let all: Vec<usize> = (0..tried.plan.series.len()).collect();
        section(&mut out, number, tried, "All points", &all);
        for s in &tried.plan.sections {
            section(&mut out, number, tried, s.title, &s.series);
        }
        followed(&mut out, tried);
        commands(&mut out, number, tried);
    }
    out.push_str("</body>\n</html>\n");
    out
}

fn introduction(run: &Run) -> String {
    let Run { threads, processors, grid, extra, .. } = run;
    let extra = if extra.is_empty() { String::new() } else { format!(", <code>{}</code> for all", html(extra)) };
    format!(
        "<h1>csbrdf: error against time and bytes</h1>\n<p>csbrdf {version}, {arch} {os}, {processors} processors, {threads} \
         threads; grid {grid}{extra}. Timings are wall clock on a machine that may do other things: compare them within \
         this page.</p>\n<ul>\n\
         <li>Error: root mean square of ln(f + eps) over the valid entries of all channels, decoded file against \
         table.</li>\n\
         <li>Encode seconds: one run, without reading the table and writing the file. Decode: whole table from \
         memory, all threads, best of {DECODES}.</li>\n\
         <li>Grey band: the Pareto front of all points of the table; what lies on it no other point beats in both \
         coordinates.</li>\n\
         <li>A point shows its command when pointed at; a click leads to its row below, where it can be copied. The \
         same figures are in report.csv, those of the solves in traces.csv.</li>\n</ul>\n",
        version = env!("CARGO_PKG_VERSION"),
        arch = std::env::consts::ARCH,
        os = std::env::consts::OS,
    )
}

/// A heading, a legend, three plots.
fn section(out: &mut String, table: usize, tried: &Tried, title: &str, series: &[usize]) {
    let _ = writeln!(out, "<h3>{}</h3>", html(title));
    let names = series.iter().map(|&s| (Style(s), tried.plan.series[s].name.as_str()));
    out.push_str(&legend(names));
    out.push_str("<div class=\"plots\">\n");
    for plot in precision(table, tried, series) {
        out.push_str(&plot.svg());
    }
    out.push_str("</div>\n");
}

fn legend<'a>(names: impl Iterator<Item = (Style, &'a str)>) -> String {
    let entry = |(style, name): (Style, &str)| format!("<span>{}{}</span>", style.swatch(), html(name));
    format!("<div class=\"legend\">{}</div>\n", names.map(entry).collect::<Vec<_>>().join("\n"))
}

/// The followed solves, block by block.
fn followed(out: &mut String, tried: &Tried) {
    if tried.followed.is_empty() {
        return;
    }
    let _ = writeln!(
        out,
        "<h3>Solves of single blocks</h3>\n<p>Blocks of 15 x 15 x 15, first component of their values (red, or \
         brightness if the colours are coded together). Smooth, glossy and stiff are the blocks of least, median and \
         greatest range of ln(f + 0.001) among those of which half the entries are valid or more. Residual: rms over \
         the samples, log domain; dashed: sigma. Gap: (u - l) / u with the best bounds u and l of the least norm so far, \
         u from a point made feasible, l from the residual as a dual point. The descent shown is SPGL1's; where samples are many \
         an encode takes a splitting method instead, about three times faster. The mark is where sigma is reached, or the limit of iterations; from \
         there on the solve is followed to a gap of {GAP}. Preset sparse solves no single blocks. One thread, of each step the \
         least time of {RUNS} runs.</p>"
    );
    for followed in tried.followed.chunk_by(|a, b| a.block == b.block) {
        let block = &followed[0].block;
        let _ = writeln!(out, "<h4>{}: number {}, log range {:.2}</h4>", block.kind, block.number, block.range);
        out.push_str(&legend(followed.iter().enumerate().map(|(i, f)| (Style(i), f.settings.as_str()))));
        out.push_str("<div class=\"plots four\">\n");
        for plot in following(followed) {
            out.push_str(&plot.svg());
        }
        out.push_str("</div>\n");
    }
}

/// A row a point, with its command.
fn commands(out: &mut String, table: usize, tried: &Tried) {
    let on_front = |cost: fn(&Point) -> f64| {
        let places: Vec<_> = tried.points.iter().map(|p| (cost(p), p.log_rms)).collect();
        pareto_front(&places)
    };
    let fronts = [
        ("e", on_front(|p| p.encode_seconds)),
        ("d", on_front(|p| p.decode_seconds)),
        ("b", on_front(|p| p.bytes as f64)),
    ];
    out.push_str(
        "<h3>Points and their commands</h3>\n<p>Front: on the Pareto front of error against e: encode seconds, d: \
         decode seconds, b: bytes. Missed: solves that ended above sigma.</p>\n<div class=\"rows\"><table>\n<tr>\
         <th>bytes</th><th>ratio</th><th>log rms</th><th>max</th><th>render PSNR, dB</th><th>encode, s</th>\
         <th>decode, ms</th><th>solves</th><th>iterations</th><th>missed</th><th class=\"text\">front</th>\
         <th class=\"text\">command</th></tr>\n",
    );
    for (i, p) in tried.points.iter().enumerate() {
        let front: Vec<&str> = fronts.iter().filter(|(_, f)| f.contains(&i)).map(|(name, _)| *name).collect();
        let _ = writeln!(
            out,
            "<tr id=\"{}\"><td>{}</td><td>{:.0}:1</td><td>{}</td><td>{}</td><td>{}</td><td>{:.2}</td><td>{:.1}</td>\
             <td>{}</td><td>{}</td><td>{}</td><td class=\"text\">{}</td><td class=\"text\"><code>{}</code></td></tr>",
            anchor(table, i),
            grouped(p.bytes),
            tried.source_bytes as f64 / p.bytes as f64,
            error_figure(p.log_rms),
            error_figure(p.log_max),
            p.psnr.map(decibel).unwrap_or_default(),
            p.encode_seconds,
            1e3 * p.decode_seconds,
            grouped(p.solves),
            grouped(p.iterations),
            grouped(p.missed),
            front.join(" "),
            html(&p.command)
        );
    }
    out.push_str("</table></div>\n");
    if !tried.left_out.is_empty() {
        out.push_str("<p>Left out, because they failed:</p>\n<ul>\n");
        for what in &tried.left_out {
            let _ = writeln!(out, "<li>{}</li>", html(what));
        }
        out.push_str("</ul>\n");
    }
}
