//! What options take: numbers with units, lists, shares, pairs.

use csbrdf::edit::salvage::WANTED;

/// One argument of several whole numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct List(pub Vec<usize>);

fn whole_numbers(text: &str, least: usize) -> Result<List, String> {
    let numbers: Vec<usize> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|n| *n >= least))
        .collect::<Option<_>>()
        .ok_or_else(|| format!("expected whole numbers from {least} up, with commas between them"))?;
    if numbers.len() > csbrdf::base::limits::MAX_AXES {
        return Err(format!("{} numbers, tables have at most {} axes", numbers.len(), csbrdf::base::limits::MAX_AXES));
    }
    Ok(List(numbers))
}

/// One length for each of the three axes of MERL's grid.
pub(super) fn lengths(text: &str) -> Result<List, String> {
    let list = whole_numbers(text, 1)?;
    if list.0.len() == 3 { Ok(list) } else { Err("expected three lengths: theta_h, theta_d, phi_d".into()) }
}

pub(super) fn indices(text: &str) -> Result<List, String> {
    whole_numbers(text, 0)
}

pub(super) fn positive<T: std::str::FromStr + Into<f64> + Copy>(text: &str) -> Result<T, String> {
    let number = text.parse::<T>().ok().filter(|x| (*x).into().is_finite() && (*x).into() > 0.0);
    number.ok_or_else(|| "expected a number above 0".into())
}

pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
    number.ok_or_else(|| "expected a number, 0 or above".into())
}

/// A number of bytes.
pub(super) fn size(text: &str) -> Result<u64, String> {
    let (number, unit) = match text.trim_end_matches(['B', 'b']) {
        n if n.ends_with(['k', 'K']) => (&n[..n.len() - 1], 1e3),
        n if n.ends_with('M') => (&n[..n.len() - 1], 1e6),
        n => (n, 1.0),
    };
    let bytes = number.trim().parse::<f64>().ok().map(|x| (x * unit).floor());
    let bytes = bytes.filter(|x| (1.0..9e15).contains(x)).map(|x| x as u64);
    bytes.ok_or_else(|| "expected bytes, or thousands with k, millions with M".into())
}

/// A number of values.
pub(super) fn values(text: &str) -> Result<usize, String> {
    let (number, unit) = match text {
        n if n.ends_with(['k', 'K']) => (&n[..n.len() - 1], 1e3),
        n if n.ends_with('M') => (&n[..n.len() - 1], 1e6),
        n if n.ends_with('G') => (&n[..n.len() - 1], 1e9),
        n => (n, 1.0),
    };
    let values = number.trim().parse::<f64>().ok().map(|x| (x * unit).floor());
    let values = values.filter(|x| (1.0..9e15).contains(x)).map(|x| x as usize);
    values.ok_or_else(|| "expected a number of values, or thousands with k, millions with M, billions with G".into())
}

pub(super) fn ratio(text: &str) -> Result<f64, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |n| (n, 100.0));
    let ratio = number.trim().parse::<f64>().ok().map(|x| x / unit);
    ratio.filter(|x| *x > 0.0 && *x <= 1.0).ok_or_else(|| "expected a share above 0, up to 1 (or 100%)".into())
}

/// `N` finite numbers between commas or blanks.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parts = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|part| !part.is_empty());
    let list: Option<Vec<f64>> = parts.map(|part| part.parse().ok().filter(|x: &f64| x.is_finite())).collect();
    list.and_then(|list| list.try_into().ok()).ok_or_else(|| format!("expected {N} numbers with commas between them"))
}

pub(super) fn key_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().into(), value.into())),
        _ => Err("expected KEY=VALUE".into()),
    }
}

/// Bits of evidence.
pub(super) fn evidence() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(1..=i64::from(WANTED))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_checked() {
        assert_eq!(ratio("5%"), Ok(0.05));
        assert_eq!(ratio("1"), Ok(1.0));
        assert!(["0", "101%", "-1", "nan", "", "%"].iter().all(|t| ratio(t).is_err()));
        assert_eq!(["60k", "1.5M", "777", "60 kB"].map(size), [Ok(60_000), Ok(1_500_000), Ok(777), Ok(60_000)]);
        assert!(["0", "-1", "k", "", "nan", "1e30", "5G"].iter().all(|t| size(t).is_err()));
        assert_eq!(
            ["300M", "1.5G", "7k", "268435456"].map(values),
            [Ok(300_000_000), Ok(1_500_000_000), Ok(7000), Ok(1 << 28)]
        );
        assert!(["0", "-1", "G", "", "inf", "1e30", "5T"].iter().all(|t| values(t).is_err()));
        assert_eq!(lengths("15, 15,15").unwrap().0, [15, 15, 15]);
        assert!(["", "0,1,1", "7", "1,2,3,4", "1,2,3,4,5", "a,1,1", "1,,2", "-1"].iter().all(|t| lengths(t).is_err()));
        assert_eq!(numbers::<3>("0,-0.5,1e0"), Ok([0.0, -0.5, 1.0]));
        assert!(["1,2", "1,2,3,4", "1,2,inf", "1,2,x"].iter().all(|t| numbers::<3>(t).is_err()));
        assert!(positive::<f32>("1e-60").is_err() && positive::<f64>("inf").is_err() && not_negative("0").is_ok());
        assert_eq!(key_value("a=b=c"), Ok(("a".into(), "b=c".into())));
        assert!(key_value("=x").is_err() && key_value("x").is_err());
    }
}
