//! Small tables that measurements are not like, each with what must come out of it.

use std::f64::consts::{FRAC_PI_2, PI};

use csbrdf::encode::contract::Contract;
use csbrdf::encode::{Effort, Encoder, Preset};
use csbrdf::table::Table;
use csbrdf::table::grid::{Axis, AxisName, Channel, Grid, Mapping};

/// A table and how far from it a file may be.
pub struct Case {
    /// What it is.
    pub name: &'static str,
    /// The table.
    pub table: Table,
    /// Most that any valid entry's ln(f + eps) may be off where every entry is a sample.
    pub log_max: f64,
}

/// Settings as the tool has them, and whether every valid entry is a sample.
pub fn settings() -> [(&'static str, Encoder, bool); 6] {
    let plain = Encoder::new;
    [
        ("default", plain(), true),
        ("--fast", plain().effort(Effort::Fast), true),
        ("--lossless", plain().lossless(true), true),
        ("--max-error 0.01", plain().contract(Contract::MaxError(MAX_ERROR)), true),
        ("--preset paper", plain().preset(Preset::Paper), false),
        ("--preset sparse", plain().preset(Preset::Sparse), false),
    ]
}

/// What `--max-error` asks for.
pub const MAX_ERROR: f64 = 0.01;

/// Axes of a grid; a fourth one stands in front, others are left out from the back.
fn axes(lens: &[usize]) -> Vec<Axis> {
    use AxisName::*;
    let names: &[AxisName] = if lens.len() == 4 { &[PhiH, ThetaH, ThetaD, PhiD] } else { &[ThetaH, ThetaD, PhiD] };
    let axis = |(&name, &len): (&AxisName, &usize)| Axis {
        name,
        len,
        mapping: if name == ThetaH { Mapping::Square } else { Mapping::Linear },
        start: 0.0,
        end: match name {
            PhiD => PI,
            PhiH => 2.0 * PI,
            _ => FRAC_PI_2,
        },
    };
    names.iter().zip(lens).map(axis).collect()
}

fn channels(count: usize) -> Vec<Channel> {
    if count == 3 {
        return Grid::rgb_channels(csbrdf::table::grid::MERL_SCALE);
    }
    let spectral = |i| Channel { name: format!("c{i}"), wavelength: Some(400.0 + i as f64), scale: 1.0 };
    (0..count).map(spectral).collect()
}

/// A grid of these lengths with this many channels: red, green and blue in MERL's units if they are three, else wavelengths.
pub fn grid(lens: &[usize], count: usize) -> csbrdf::Result<Grid> {
    Grid::new(axes(lens), channels(count))
}

/// Something smooth, of 0.02 to 20 in the units of the source, at entry `i` of a channel.
pub fn smooth(i: usize) -> f64 {
    let x = i as f64;
    (3.0 * (0.011 * x).sin() + 0.3 * (0.13 * x).cos()).exp()
}

/// NaN of other bits than the usual one.
fn odd_nan(payload: u64) -> f64 {
    f64::from_bits(f64::NAN.to_bits() ^ (1 << 63) | payload)
}

/// All cases.
pub fn cases() -> Vec<Case> {
    /// Not a multiple of any block but those of its own lengths.
    const USUAL: [usize; 3] = [5, 7, 11];
    const LAST: usize = 5 * 7 * 11 - 1;
    let case = |name, lens: &[usize], count: usize, log_max: f64, value: &dyn Fn(usize, usize) -> f64| {
        let grid = grid(lens, count).expect("within the limits");
        let n = grid.positions();
        let values = (0..count).flat_map(|c| (0..n).map(move |i| value(c, i))).collect();
        Case { name, table: Table::from_values(grid, values).expect("as many as the grid has"), log_max }
    };
    let usual = |name, log_max, value: &dyn Fn(usize, usize) -> f64| case(name, &USUAL, 3, log_max, value);
    // From 10^-300 to 10^300 along the table, and the same in an order without any.
    let decades = |i: usize| 10f64.powf(-300.0 + 600.0 * i as f64 / LAST as f64);
    vec![
        usual("smooth", 0.2, &|_, i| smooth(i)),
        usual("one valid entry", 1e-3, &|c, i| if (c, i) == (1, 200) { 3.0 } else { -1.0 }),
        usual("two valid entries, of two channels", 0.1, &|c, i| match (c, i) {
            (0, 0) => 1e-5,
            (2, LAST) => 1e5,
            _ => f64::NAN,
        }),
        usual("one channel invalid", 0.2, &|c, i| if c == 1 { -1.0 } else { smooth(i) }),
        usual("one channel valid", 0.2, &|c, i| if c == 2 { smooth(i) } else { f64::NEG_INFINITY }),
        usual("every second entry invalid", 0.2, &|_, i| if i % 2 == 0 { smooth(i) } else { -1.0 }),
        usual("constant 1", 3e-3, &|_, _| 1.0),
        usual("constant 1e-3, a channel 1e3", 3e-3, &|c, _| if c == 0 { 1e3 } else { 1e-3 }),
        usual("constant 0", 0.0, &|_, _| 0.0),
        usual("constant -0", 0.0, &|_, _| -0.0),
        usual("constant 5e-324", 3e-3, &|_, _| 5e-324),
        usual("constant 1.8e308", 3e-3, &|_, _| f64::MAX),
        usual("zeros among smooth", 0.2, &|_, i| if i % 3 == 0 { 0.0 } else { smooth(i) }),
        usual("-0 among smooth", 0.2, &|_, i| if i % 5 == 0 { -0.0 } else { smooth(i) }),
        usual("denormals", 3e-3, &|c, i| f64::from_bits(1 + (c * 385 + i) as u64 * 0x0000_0123_4567_89AB)),
        usual("1e-300 to 1e300, in order", 0.3, &|_, i| decades(i)),
        usual("1e-300 to 1e300, in no order", 0.3, &|c, i| decades((i * 144 + c * 100) % (LAST + 1))),
        usual("1e-9 and 1e5 in turn", 0.3, &|_, i| if i % 2 == 0 { 1e-9 } else { 1e5 }),
        usual("one spike of 1e9", 0.6, &|_, i| if i == 200 { 1e9 } else { 1e-3 }),
        usual("NaN of many bits, infinities", 0.2, &|_, i| match i % 9 {
            0 => odd_nan(i as u64),
            1 => f64::from_bits(0x7FF0_0000_0000_0001 + i as u64),
            2 => f64::INFINITY,
            3 => f64::NEG_INFINITY,
            4 => -f64::MIN_POSITIVE / 4.0,
            _ => smooth(i),
        }),
        case("1 x 1 x 1, one channel", &[1, 1, 1], 1, 0.05, &|_, _| 0.25),
        case("1 x 1 x 1, three channels", &[1, 1, 1], 3, 0.1, &|c, _| [0.0, 1e-3, 1e3][c]),
        case("1 x 1 x 1, 4096 channels", &[1, 1, 1], 4096, 0.1, &|c, _| smooth(c)),
        case("1000 x 1 x 1", &[1000, 1, 1], 3, 0.2, &|_, i| smooth(i)),
        case("1 x 1000 x 1", &[1, 1000, 1], 2, 0.2, &|_, i| smooth(i)),
        case("1 x 1 x 1000", &[1, 1, 1000], 1, 0.2, &|_, i| smooth(i)),
        case("one axis of 65,536", &[65536], 1, 0.2, &|_, i| smooth(i)),
        case("two axes", &[31, 37], 3, 0.2, &|_, i| smooth(i)),
        case("four axes", &[5, 6, 7, 11], 3, 0.2, &|c, i| if (i + c) % 13 == 0 { -1.0 } else { smooth(i) }),
        case("17 x 9 x 13", &[17, 9, 13], 3, 0.2, &|_, i| smooth(i)),
        case("60 channels", &[3, 4, 5], 60, 0.2, &|c, i| smooth(60 * c + i)),
    ]
}
