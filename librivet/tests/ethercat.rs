//! Tests of the modules of `examples/ethercat`: an example of cargo is either a program or tests.
#![allow(dead_code, reason = "the program of the example uses the rest")]

#[path = "../../examples/ethercat/arguments.rs"]
mod arguments;
#[path = "../../examples/ethercat/arm.rs"]
mod arm;
#[path = "../../examples/ethercat/bus.rs"]
mod bus;
#[path = "../../examples/ethercat/drive.rs"]
mod drive;
#[path = "../../examples/ethercat/scaling.rs"]
mod scaling;
