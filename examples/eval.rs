//! Evaluates a file in the plane of incidence: `cargo run --release --example eval -- FILE.csbrdf`.

use csbrdf::{Brdf, Result};

fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or("tests/data/v1/final-corrected.csbrdf".into());
    let brdf = Brdf::open(&path)?;

    // Directions point away from the surface, z along its normal.
    let direction = |degrees: f64| [degrees.to_radians().sin(), 0.0, degrees.to_radians().cos()];
    let wi = direction(-30.0);
    for degrees in (-80..=80).step_by(10) {
        let [r, g, b] = brdf.eval(wi, direction(degrees.into()))?; // 1/sr
        println!("{degrees:4} degrees: {r:.5} {g:.5} {b:.5}");
    }

    let touched = brdf.touched().blocks().iter().filter(|touched| **touched).count();
    println!("looked at {touched} of {} blocks", brdf.reader().block_count());
    Ok(())
}
