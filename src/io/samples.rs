//! Lists of measurements as CSV: a plan on the way out, the measured values on the way in.
//!
//! One row a measurement, under a row of column names; lines that begin with `#` are comments. Columns:
//!
//! | columns | meaning |
//! | --- | --- |
//! | `theta_h_bin` `theta_d_bin` `phi_d_bin` | bin along each axis, from 0 |
//! | `theta_h_deg` `theta_d_deg` `phi_d_deg` | half and difference angles, degrees; of a plan: at the centre of the bin (bin coordinate `i + 0.5`) unless that is below the horizon |
//! | `wi_x` `wi_y` `wi_z` `wo_x` `wo_y` `wo_z` | directions to the light and to the sensor, z along the normal; of any length, of a plan 1 |
//! | `theta_i_deg` `phi_i_deg` `theta_o_deg` `phi_o_deg` | the same as elevation from the normal and azimuth, degrees |
//! | `r` `g` `b` | measured values, 1/sr |
//!
//! A plan has all but the last three. A list to read needs these and at least one other line of the table above, complete;
//! where it has several, they must agree on the bin. Columns may be in any order and of either case, others are
//! ignored.

use std::fmt::Write as _;
use std::io::Write;

use csv::{ByteRecord, ReaderBuilder, Trim};

use crate::assess::plan::Plan;
use crate::base::error::{Error, Result};
use crate::base::excerpt::excerpt;
use crate::table::Table;
use crate::table::coords::{Lookup, taps};
use crate::table::grid::{Grid, MERL_SCALE};
use crate::table::parameterization::Parameterization;

const NAME: &str = "list of measurements";

const BINS: [&str; 3] = ["theta_h_bin", "theta_d_bin", "phi_d_bin"];
const HALF_DIFF: [&str; 3] = ["theta_h_deg", "theta_d_deg", "phi_d_deg"];
const VECTORS: [&str; 6] = ["wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z"];
const INSTRUMENT: [&str; 4] = ["theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg"];
const VALUES: [&str; 3] = ["r", "g", "b"];

/// Largest value that is taken for a measurement, 1/sr.
pub const LARGEST: f64 = 1e12;

/// Writes a plan, with the values that `table` has in its bins if one is given: -1 where it has none.
///
/// # Errors
/// `InvalidArgument` if the table is not on the plan's grid or has not three channels; `Io` if the writer fails.
pub fn write_plan(plan: &Plan, table: Option<&Table>, mut out: impl Write) -> Result<()> {
    if let Some(table) = table
        && (table.grid().axes() != plan.grid.axes() || table.grid().channels().len() != 3)
    {
        return Err(Error::InvalidArgument("the values are of another grid than the plan".into()));
    }
    let [h, d, p] = plan.block_shape;
    let phi_d = plan.grid.shape()[3];
    writeln!(
        out,
        "# csbrdf plan version={} grid={phi_d} sampling={} seed={} block={h}x{d}x{p} rows={} candidates={}",
        env!("CARGO_PKG_VERSION"),
        plan.sampling.ratio(),
        plan.seed,
        plan.rows.len(),
        plan.candidates,
    )?;
    writeln!(
        out,
        "# Angles in degrees; z is the normal. Add the columns r g b: values in 1/sr; then csbrdf encode --samples"
    )?;
    let mut names = [&BINS[..], &HALF_DIFF, &VECTORS, &INSTRUMENT].concat();
    if table.is_some() {
        names.extend(VALUES);
    }
    writeln!(out, "{}", names.join(","))?;
    let mut line = String::new();
    for row in &plan.rows {
        line.clear();
        let [h, d, p] = row.bin;
        let _ = write!(line, "{h},{d},{p}");
        for angle in [row.angles.theta_h, row.angles.theta_d, row.angles.phi_d] {
            let _ = write!(line, ",{:.7}", angle.to_degrees());
        }
        for x in row.wi.iter().chain(&row.wo) {
            let _ = write!(line, ",{x:.9}");
        }
        for angle in row.instrument_angles() {
            let _ = write!(line, ",{:.7}", angle.to_degrees());
        }
        if let Some(table) = table {
            let at = plan.position(row);
            for (c, channel) in table.grid().channels().iter().enumerate() {
                let value = if table.valid_plane(c)[at] { table.plane(c)[at] * channel.scale } else { -1.0 };
                let _ = write!(line, ",{value:?}");
            }
        }
        writeln!(out, "{line}")?;
    }
    Ok(())
}

/// A list that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// On MERL's grid, valid where all three channels were measured.
    pub table: Table,
    /// Rows of the list.
    pub rows: usize,
    /// Bins that were measured.
    pub bins: usize,
    /// Rows without a measurement: a value is empty or negative.
    pub unmeasured: usize,
    /// Measured rows beyond the first of their bin. The value of a bin is the mean of its rows, of the values
    /// themselves and not of their logarithms: noise about zero averages out.
    pub repeated: usize,
}

/// Reads a list of measurements onto MERL's grid: `grid`, else the one that a comment names (`grid=180` or `grid=360`,
/// the bins of phi_d), else that of 180 bins.
///
/// # Errors
/// `InvalidArgument` if `grid` is not one of MERL's. `Corrupt`, with the line and column and what to do, if a column is
/// missing or twice there, a row is of another length than the column names, a field is no number, NaN, infinite or out
/// of its range, a direction is below the horizon, columns disagree on the bin, or no row holds a measurement.
pub fn read_samples(data: &[u8], grid: Option<Grid>) -> Result<Samples> {
    // The mark that some spreadsheets put in front of UTF-8.
    let data = data.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(data);
    let grid = match (grid, commented_grid(data)) {
        (Some(grid), _) => grid,
        (None, None | Some(180)) => Grid::merl(),
        (None, Some(360)) => Grid::merl_360(),
        (None, Some(other)) => {
            let what = format!("its comment says grid={other}; known are grid=180 and grid=360, the bins of phi_d");
            return Err(Error::corrupt(NAME, 0, what));
        }
    };
    if [Grid::merl(), Grid::merl_360()].iter().all(|merl| *merl != grid) {
        return Err(Error::InvalidArgument("measurements are read onto MERL's grids only".into()));
    }
    let mut reader =
        ReaderBuilder::new().has_headers(false).flexible(true).comment(Some(b'#')).trim(Trim::All).from_reader(data);
    let parameterization = Parameterization::of(&grid)?;
    let mut row = Row { data, grid: &grid, parameterization, columns: Columns::default(), record: ByteRecord::new() };
    if !row.next(&mut reader)? {
        return Err(Error::corrupt(NAME, 0, "is empty; begin it with a row of column names, as csbrdf plan does"));
    }
    row.columns = row.names()?;

    let n = grid.positions();
    let (mut sums, mut counts) = (vec![0.0; 3 * n], vec![0u32; n]);
    let (mut rows, mut unmeasured) = (0, 0);
    while row.next(&mut reader)? {
        rows += 1;
        let at = row.position()?;
        match row.values()? {
            Some(values) => {
                counts[at] += 1;
                (0..3).for_each(|c| sums[c * n + at] += values[c]);
            }
            None => unmeasured += 1,
        }
    }
    let bins = counts.iter().filter(|count| **count > 0).count();
    if bins == 0 {
        let what = match rows {
            0 => "no row follows the column names; add one for each measurement".into(),
            _ => format!("none of the {rows} rows holds a measurement: values are empty or negative; add them in 1/sr"),
        };
        return Err(Error::corrupt(NAME, data.len() as u64, what));
    }
    for c in 0..3 {
        for (sum, &count) in sums[c * n..(c + 1) * n].iter_mut().zip(&counts) {
            *sum = if count == 0 { -1.0 } else { *sum / f64::from(count) / MERL_SCALE[c] };
        }
    }
    let repeated = rows - unmeasured - bins;
    Ok(Samples { table: Table::from_values(grid, sums)?, rows, bins, unmeasured, repeated })
}

/// Whether the column names that text begins with are those of a list.
pub(super) fn is_list(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    let mut lines = head.split(|b| *b == b'\n').map(<[u8]>::trim_ascii);
    let names = lines.find(|line| !line.is_empty() && !line.starts_with(b"#")).unwrap_or_default();
    let known = [BINS[0], HALF_DIFF[0], VECTORS[0], INSTRUMENT[0]];
    let is_known = |name: &[u8]| known.iter().any(|known| name.trim_ascii().eq_ignore_ascii_case(known.as_bytes()));
    names.contains(&b',') && names.split(|b| *b == b',').any(is_known)
}

/// The bins of phi_d that the comments at the start name.
fn commented_grid(data: &[u8]) -> Option<usize> {
    let comments = data.split(|b| *b == b'\n').take_while(|line| line.starts_with(b"#"));
    let words = comments.flat_map(|line| line.split(|b| b.is_ascii_whitespace() || *b == b','));
    words.filter_map(|word| word.strip_prefix(b"grid=")).find_map(|n| std::str::from_utf8(n).ok()?.parse().ok())
}

/// Where the columns are in a row; groups that the list does not have are `None`.
#[derive(Default)]
struct Columns {
    count: usize,
    bins: Option<[usize; 3]>,
    half_diff: Option<[usize; 3]>,
    vectors: Option<[usize; 6]>,
    instrument: Option<[usize; 4]>,
    values: [usize; 3],
}

/// The row being read and what is needed to understand it.
struct Row<'a> {
    data: &'a [u8],
    grid: &'a Grid,
    parameterization: Parameterization,
    columns: Columns,
    record: ByteRecord,
}

impl Row<'_> {
    /// Reads the next row; false at the end.
    fn next(&mut self, reader: &mut csv::Reader<&[u8]>) -> Result<bool> {
        let more = reader.read_byte_record(&mut self.record);
        let more = more.map_err(|e| Error::corrupt(NAME, 0, format!("{e}; write it as comma-separated text")))?;
        if more && self.columns.count > 0 && self.record.len() != self.columns.count {
            let (got, expected) = (self.record.len(), self.columns.count);
            return Err(
                self.bad(format!("{got} fields under {expected} column names; fields are separated by one comma"))
            );
        }
        Ok(more)
    }

    /// An error in this row.
    fn bad(&self, what: impl std::fmt::Display) -> Error {
        // The reader's position is before the comments and blank lines that it skipped.
        let mut at = self.record.position().map_or(0, |p| p.byte() as usize).min(self.data.len());
        while let Some(end) = self.data[at..].iter().position(|b| *b == b'\n') {
            let line = &self.data[at..at + end];
            if !line.starts_with(b"#") && line.iter().any(|b| *b != b'\r') {
                break;
            }
            at += end + 1;
        }
        let line = 1 + self.data[..at].iter().filter(|b| **b == b'\n').count();
        Error::corrupt(NAME, at as u64, format!("line {line}: {what}"))
    }

    fn field(&self, column: usize) -> String {
        String::from_utf8_lossy(self.record.get(column).unwrap_or_default()).into_owned()
    }

    /// Finds the columns from their names, which this row holds.
    fn names(&self) -> Result<Columns> {
        let names: Vec<String> = (0..self.record.len()).map(|i| self.field(i).to_ascii_lowercase()).collect();
        let columns = Columns {
            count: names.len(),
            bins: self.group(&names, BINS)?,
            half_diff: self.group(&names, HALF_DIFF)?,
            vectors: self.group(&names, VECTORS)?,
            instrument: self.group(&names, INSTRUMENT)?,
            values: [0; 3],
        };
        let none = columns.bins.is_none()
            && columns.half_diff.is_none()
            && columns.vectors.is_none()
            && columns.instrument.is_none();
        if none {
            let hint = if names.len() == 1 { ", separated by commas" } else { "" };
            return Err(self.bad(format!(
                "no columns say what was measured; name them {}{hint}, or as csbrdf plan does",
                BINS.join(", ")
            )));
        }
        let Some(values) = self.group(&names, VALUES)? else {
            return Err(self.bad("column r is missing, g and b too; add the measured values in 1/sr as r, g, b"));
        };
        Ok(Columns { values, ..columns })
    }

    /// The columns of a group; `None` if the list has none of them.
    fn group<const N: usize>(&self, names: &[String], group: [&str; N]) -> Result<Option<[usize; N]>> {
        let mut found = [None; N];
        for (place, name) in found.iter_mut().zip(group) {
            let mut places = (0..names.len()).filter(|&i| names[i] == name);
            *place = places.next();
            if places.next().is_some() {
                return Err(self.bad(format!("column {name} is there twice; remove or rename one")));
            }
        }
        if found.iter().all(Option::is_none) {
            return Ok(None);
        }
        if let Some(missing) = (0..N).find(|&i| found[i].is_none()) {
            let whole = group.join(", ");
            return Err(self.bad(format!("column {} is missing; give all of {whole}", group[missing])));
        }
        Ok(Some(found.map(|place| place.expect("all are there"))))
    }

    /// The finite number in a column, within bounds.
    fn number(&self, column: usize, name: &str, least: f64, most: f64) -> Result<f64> {
        let text = self.field(column);
        let what = match text.parse::<f64>() {
            Ok(x) if (least..=most).contains(&x) => return Ok(x),
            Ok(x) if x.is_nan() => "is not a number; leave what was not measured empty".into(),
            Ok(x) => format!("{x} is out of range, {least} to {most}; correct it"),
            Err(_) if text.is_empty() => "is empty; give a number".into(),
            Err(_) => format!("{:?} is not a number; write it like 0.25 or 2.5e-1", excerpt(&text)),
        };
        Err(self.bad(format!("column {name}: {what}")))
    }

    fn numbers<const N: usize>(&self, at: [usize; N], names: [&str; N], range: [f64; 2]) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for i in 0..N {
            numbers[i] = self.number(at[i], names[i], range[0], range[1])?;
        }
        Ok(numbers)
    }

    /// Linear index of the bin, on which all columns must agree.
    fn position(&self) -> Result<usize> {
        let mut found: Option<(usize, &str)> = None;
        let mut agree = |at: usize, from: &'static str| match found.replace((at, from)) {
            Some((other, name)) if other != at => {
                let (one, two) = (self.bin_text(other), self.bin_text(at));
                Err(self.bad(format!(
                    "{name} and on say bin {one}, {from} and on bin {two}; correct one, or leave one out"
                )))
            }
            _ => Ok(()),
        };
        if let Some(at) = self.columns.bins {
            agree(self.bin_of_numbers(at)?, BINS[0])?;
        }
        if let Some(at) = self.columns.half_diff {
            agree(self.bin_of_half_diff(at)?, HALF_DIFF[0])?;
        }
        if let Some(at) = self.columns.vectors {
            let [a, b, c, d, e, f] = self.numbers(at, VECTORS, [-1e100, 1e100])?;
            agree(self.bin_of_directions([a, b, c], [d, e, f], "wi and wo")?, VECTORS[0])?;
        }
        if let Some(at) = self.columns.instrument {
            let [ti, pi, to, po] = self.numbers(at, INSTRUMENT, [-720.0, 720.0])?;
            for (theta, i) in [(ti, 0), (to, 2)] {
                if !(0.0..=90.0).contains(&theta) {
                    self.number(at[i], INSTRUMENT[i], 0.0, 90.0)?;
                }
            }
            agree(self.bin_of_directions(direction(ti, pi), direction(to, po), "the angles")?, INSTRUMENT[0])?;
        }
        Ok(found.expect("one group is there").0)
    }

    fn bin_text(&self, at: usize) -> String {
        let [_, _, d, p] = self.grid.shape();
        format!("({}, {}, {})", at / p / d, at / p % d, at % p)
    }

    fn bin_of_numbers(&self, at: [usize; 3]) -> Result<usize> {
        let mut index = 0;
        for i in 0..3 {
            let len = self.grid.axes()[i].len;
            let bin = self.number(at[i], BINS[i], 0.0, (len - 1) as f64)?;
            if bin.fract() != 0.0 {
                return Err(self.bad(format!("column {}: {bin} is no whole number; bins are counted from 0", BINS[i])));
            }
            index = index * len + bin as usize;
        }
        Ok(index)
    }

    fn bin_of_half_diff(&self, at: [usize; 3]) -> Result<usize> {
        let mut coordinates = [0.5; 4];
        for (i, axis) in self.grid.axes().iter().enumerate() {
            let period = self.parameterization.period(i);
            let (least, most) = if period.is_some() { (-360.0, 360.0) } else { (0.0, 90.0) };
            let angle = self.number(at[i], HALF_DIFF[i], least, most)?.to_radians();
            // phi_d of half a turn repeats by reciprocity.
            coordinates[i + 1] = axis.coordinate(period.map_or(angle, |period| angle.rem_euclid(period)));
        }
        Ok(taps(self.grid, coordinates, Lookup::Nearest).as_slice()[0].0)
    }

    fn bin_of_directions(&self, wi: [f64; 3], wo: [f64; 3], name: &str) -> Result<usize> {
        match self.parameterization.coordinates(wi, wo) {
            Some(coordinates) => Ok(taps(self.grid, coordinates, Lookup::Nearest).as_slice()[0].0),
            None => {
                Err(self.bad(format!("{name} are below the horizon, zero or opposite; give directions with z above 0")))
            }
        }
    }

    /// The measured values; `None` if one is empty or negative.
    fn values(&self) -> Result<Option<[f64; 3]>> {
        let mut values = [0.0; 3];
        let mut measured = true;
        for (i, &column) in self.columns.values.iter().enumerate() {
            if self.record.get(column).is_none_or(<[u8]>::is_empty) {
                measured = false;
                continue;
            }
            values[i] = self.number(column, VALUES[i], -LARGEST, LARGEST)?;
            measured &= values[i] >= 0.0;
        }
        Ok(measured.then_some(values))
    }
}

/// Unit direction of an elevation from the normal and an azimuth, degrees.
fn direction(theta: f64, phi: f64) -> [f64; 3] {
    let (sin, cos) = theta.to_radians().sin_cos();
    let (sin_phi, cos_phi) = phi.to_radians().sin_cos();
    // The cosine of 90 degrees is not quite zero, and never below.
    [sin * cos_phi, sin * sin_phi, cos.max(0.0)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::sample::Sampling;

    fn plan(grid: &Grid) -> Plan {
        Plan::draw(grid, Sampling::from_ratio(0.02).unwrap(), 3, [15, 15, 15], None).unwrap()
    }

    fn text_of(plan: &Plan, table: Option<&Table>) -> String {
        let mut text = Vec::new();
        write_plan(plan, table, &mut text).unwrap();
        String::from_utf8(text).unwrap()
    }

    /// Fails with an error that holds all of `parts`.
    #[track_caller]
    fn fails(text: &str, parts: &[&str]) {
        let error = read_samples(text.as_bytes(), None).unwrap_err();
        assert!(matches!(error, Error::Corrupt { .. }));
        let error = error.to_string();
        for part in parts {
            assert!(error.contains(part), "{part:?} is not in {error:?}");
        }
    }

    fn table(text: &str) -> Samples {
        read_samples(text.as_bytes(), None).unwrap()
    }

    #[test]
    fn a_filled_plan_comes_back_as_the_table_at_its_bins() {
        for grid in [Grid::merl(), Grid::merl_360()] {
            let plan = plan(&grid);
            let n = grid.positions();
            let mut values: Vec<f64> = (0..3 * n).map(|i| (i % 977) as f64 * 0.1).collect();
            let first = plan.position(&plan.rows[0]);
            values[n + first] = -1.0;
            let full = Table::from_values(grid.clone(), values).unwrap();
            let samples = table(&text_of(&plan, Some(&full)));
            assert_eq!((samples.rows, samples.unmeasured, samples.repeated), (plan.rows.len(), 1, 0));
            assert_eq!(samples.bins, plan.rows.len() - 1);
            assert_eq!(samples.table.grid(), &grid);
            assert_eq!(samples.table.valid_count(), 3 * samples.bins);
            for row in &plan.rows[1..] {
                for c in 0..3 {
                    let (a, b) = (samples.table.plane(c)[plan.position(row)], full.plane(c)[plan.position(row)]);
                    assert!((a - b).abs() <= 1e-14 * b, "{a} {b}");
                }
            }
        }
    }

    /// Each group of columns alone leads to the same bins as all of them together.
    #[test]
    fn any_group_of_columns_says_the_bin() {
        let grid = Grid::merl();
        let plan = plan(&grid);
        let full = Table::from_values(grid.clone(), vec![1.0; 3 * grid.positions()]).unwrap();
        let text = text_of(&plan, Some(&full));
        let expected = table(&text);
        for kept in [0..3, 3..6, 6..12, 12..16] {
            let part: String = text
                .lines()
                .filter(|line| !line.starts_with('#'))
                .map(|line| {
                    let fields: Vec<&str> = line.split(',').collect();
                    format!("{},{}\r\n", fields[16..].join(","), fields[kept.clone()].join(","))
                })
                .collect();
            assert_eq!(table(&part), expected, "{kept:?}");
        }
    }

    #[test]
    fn order_case_comments_blanks_and_other_columns_do_not_matter() {
        let a = table("theta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n1,2,3,0.5,0.25,0\n4,5,6,1,1,1\n");
        let b = table(
            "\u{FEFF}# note\n G , note, B ,R,phi_d_bin,theta_d_bin,Theta_h_bin\n\n1,\"x, y\",1,1,6,5,4\n# mid\n0.25,,0,.5,3.0,2,1\n",
        );
        assert_eq!(a, b);
        assert_eq!(a.bins, 2);
    }

    #[test]
    fn repeated_rows_are_averaged_and_unmeasured_ones_counted() {
        let head = "theta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n";
        let read = table(&format!("{head}0,0,1,1,0,3\n0,0,1,2,1,3\n0,0,1,-1,5,5\n0,0,2,,,\n0,0,2,,1,1\n"));
        assert_eq!((read.rows, read.bins, read.unmeasured, read.repeated), (5, 1, 3, 1));
        for (c, mean) in [1.5, 0.5, 3.0].into_iter().enumerate() {
            assert!((read.table.plane(c)[1] * MERL_SCALE[c] - mean).abs() < 1e-12);
        }
    }

    #[test]
    fn mistakes_are_named_with_line_column_and_remedy() {
        let head = "# c\ntheta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n";
        let row = |row: &str| format!("{head}0,0,0,1,1,1\n# comment\n\n{row}\n");
        fails("", &["is empty", "column names"]);
        fails("# only a comment\n", &["is empty"]);
        fails(head, &["no row follows"]);
        fails(&format!("{head}0,0,0,-1,0,0\n"), &["none of the 1 rows"]);
        fails(&row("0,0,0,1,x,1"), &["line 6: column g: \"x\" is not a number", "write it like"]);
        fails(&row("0,0,0,1,1,NaN"), &["line 6: column b: is not a number", "empty"]);
        fails(&row("0,0,0,inf,1,1"), &["line 6: column r", "out of range"]);
        fails(&row("0,0,0,1e13,1,1"), &["line 6: column r", "out of range"]);
        fails(&row("90,0,0,1,1,1"), &["line 6: column theta_h_bin: 90 is out of range, 0 to 89"]);
        fails(&row("0,0,-1,1,1,1"), &["column phi_d_bin: -1 is out of range, 0 to 179"]);
        fails(&row("0,0.5,0,1,1,1"), &["column theta_d_bin: 0.5 is no whole number"]);
        fails(&row("0,,0,1,1,1"), &["column theta_d_bin: is empty"]);
        fails(&row("0,0,0,1,1"), &["line 6: 5 fields under 6 column names"]);
        fails(&row("0,0,0,0,5,1,1,1"), &["line 6: 8 fields under 6"]);
        fails("theta_h_bin,theta_d_bin,r,g,b\n", &["line 1: column phi_d_bin is missing"]);
        fails("theta_h_bin,theta_d_bin,phi_d_bin\n", &["column r is missing", "1/sr"]);
        fails("theta_h_bin,theta_d_bin,phi_d_bin,r,g\n", &["column b is missing"]);
        fails("theta_h_bin,theta_d_bin,phi_d_bin,r,g,b,R\n", &["column r is there twice"]);
        fails("theta_h_bin;theta_d_bin;phi_d_bin;r;g;b\n", &["separated by commas"]);
        fails("a,b,c\n", &["no columns say what was measured"]);
        let angles = |row: &str| format!("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,r,g,b\n{row},1,1,1\n");
        fails(&angles("91,0,0,0"), &["line 2: column theta_i_deg: 91 is out of range, 0 to 90"]);
        fails(&angles("90,0,90,180"), &["opposite"]);
        assert_eq!(table(&angles("90,0,45,180")).bins, 1);
        fails("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,r,g,b\n0,0,1,0,0.1,-0.1,1,1,1\n", &["line 2: wi and wo are below"]);
        let both = "theta_h_bin,theta_d_bin,phi_d_bin,theta_h_deg,theta_d_deg,phi_d_deg,r,g,b\n";
        fails(&format!("{both}1,20,30,0.02,20.5,31.5,1,1,1\n"), &["line 2", "bin (1, 20, 30)", "bin (1, 20, 31)"]);
    }

    #[test]
    fn the_grid_is_the_callers_or_the_comments() {
        let text = "# csbrdf plan grid=360 seed=1,,,\ntheta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n0,0,200,1,1,1\n";
        assert_eq!(table(text).table.grid(), &Grid::merl_360());
        assert!(read_samples(text.as_bytes(), Some(Grid::merl())).is_err());
        let other = text.replace("grid=360", "grid=720");
        assert!(read_samples(other.as_bytes(), None).err().unwrap().to_string().contains("grid=720"));
        let flat = Grid::new(Grid::merl().axes()[..2].to_vec(), Grid::rgb_channels([1.0; 3])).unwrap();
        assert!(matches!(read_samples(text.as_bytes(), Some(flat)), Err(Error::InvalidArgument(_))));
    }
}
