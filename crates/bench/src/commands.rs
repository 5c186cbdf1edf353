//! One module a command. What is left out has a stand-in that says so.

#[cfg(feature = "studies")]
pub mod blind;
#[cfg(feature = "lab")]
pub mod calibrate;
#[cfg(all(feature = "lab", feature = "studies"))]
pub mod check;
pub mod completions;
#[cfg(feature = "lab")]
pub mod devices;
pub mod diagnose;
pub mod diff;
pub mod effects;
#[cfg(feature = "lab")]
pub mod emulate;
pub mod export;
#[cfg(feature = "lab")]
pub mod hil;
#[cfg(feature = "studies")]
pub mod identify;
#[cfg(feature = "exchange")]
pub mod import;
pub mod info;
#[cfg(feature = "studies")]
pub mod laws;
pub mod man;
#[cfg(feature = "studies")]
pub mod paper;
#[cfg(feature = "lab")]
pub mod record_frames;
pub mod recover;
pub mod report;
pub mod rigs;
#[cfg(feature = "lab")]
pub mod runs;
#[cfg(all(feature = "lab", feature = "studies"))]
pub mod schema;
pub mod sim;
#[cfg(feature = "studies")]
pub mod sweep;
#[cfg(feature = "lab")]
pub mod test;
#[cfg(feature = "lab")]
pub mod track;
pub mod tracks;
#[cfg(feature = "studies")]
pub mod tune;
pub mod udev;
pub mod verify;

#[cfg(not(feature = "exchange"))]
crate::left_out::stand_in! {
    import: "import" "exchange";
}
#[cfg(not(feature = "lab"))]
crate::left_out::stand_in! {
    calibrate: "calibrate" "lab";
    devices: "devices" "lab";
    emulate: "emulate" "lab";
    hil: "hil" "lab";
    record_frames: "record-frames" "lab";
    runs: "runs" "lab";
    test: "test" "lab";
    track: "track" "lab";
}
#[cfg(not(feature = "studies"))]
crate::left_out::stand_in! {
    blind: "blind" "studies";
    identify: "identify" "studies";
    laws: "laws" "studies";
    paper: "paper" "studies";
    sweep: "sweep" "studies";
    tune: "tune" "studies";
}
#[cfg(not(all(feature = "lab", feature = "studies")))]
crate::left_out::stand_in! {
    check: "check" "lab,studies";
    schema: "schema" "lab,studies";
}
