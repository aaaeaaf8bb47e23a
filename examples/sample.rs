//! The albedo of a file by importance sampling: `cargo run --release --example sample -- FILE.csbrdf`.

use csbrdf::{Brdf, Result};

const DRAWS: u32 = 4096;

fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or("tests/data/v1/final-corrected.csbrdf".into());
    let brdf = Brdf::open(&path)?;
    let wi = [0.5, 0.0, 0.75_f64.sqrt()];
    let mut albedo = [0.0; 3];
    for i in 0..DRAWS {
        // Any numbers in [0, 1); these cover the square evenly.
        let u = [(f64::from(i) + 0.5) / f64::from(DRAWS), (f64::from(i) * 0.618_033_988_749_895).fract()];
        // `None` only if `wi` is not above the horizon.
        let Some(sample) = brdf.sample(wi, u)? else { continue };
        let weight = sample.wo[2] / sample.pdf / f64::from(DRAWS);
        let f = brdf.eval(wi, sample.wo)?;
        albedo.iter_mut().zip(f).for_each(|(albedo, f)| *albedo += f64::from(f) * weight);
    }
    println!("of light from 30 degrees the material reflects {albedo:.4?} (red, green, blue)");
    Ok(())
}
