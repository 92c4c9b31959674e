//! Black-box tests of the program. They share one binary, because each separate binary would link polars again.

#![allow(clippy::unwrap_used, unreachable_pub)]

mod common;

mod another_robot;
mod bad_input;
mod branches;
mod browser;
mod chains;
mod cli;
mod compare;
mod damage;
mod design;
mod documents;
mod export;
mod faults;
mod folders;
mod hostile;
mod init;
mod inspect;
mod keys;
mod kill;
mod manners;
mod mistakes;
mod nights;
mod optimise;
mod own_table;
mod scheduling;
mod sensitivities;
mod shards;
mod shared;
mod simulate;
mod source;
mod synth;
mod terminal;
mod update;
