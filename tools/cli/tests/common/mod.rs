//! What the tests of the command-line tool share. Each uses some of it.
#![allow(dead_code)]

/// Exit codes.
pub const OK: i32 = 0;
pub const OPERATION: i32 = 1;
pub const USAGE: i32 = 2;
pub const BAD_INPUT: i32 = 3;
pub const UNSUPPORTED: i32 = 4;
pub const BROKEN_PIPE: i32 = 141;

/// Settings that encode fast.
pub const FAST: [&str; 4] = ["--block", "15,15,15", "--quality", "0.5"];
