//! A diagnosis told to people: on a terminal, and as a page.

pub mod page;
pub mod report;
pub mod terminal;
pub mod told;
