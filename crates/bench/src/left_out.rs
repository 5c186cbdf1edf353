//! What a program says that was built without a part of it.

/// That something is not there, and how it comes.
pub fn left_out(what: &str, feature: &str) -> anyhow::Error {
    anyhow::anyhow!(
        "this program was built without {what}: build it without --no-default-features, or with --features {feature}"
    )
}

/// What stands for the station of a single flight.
#[cfg(not(feature = "lab"))]
#[derive(clap::Args)]
#[group(skip)]
pub struct StationArgument {
    #[arg(long, value_name = "FOLDER", hide = true)]
    station: Option<std::path::PathBuf>,
}

#[cfg(not(feature = "lab"))]
impl StationArgument {
    /// An error if a station is named.
    pub fn refuse(&self) -> anyhow::Result<()> {
        self.station.as_ref().map_or(Ok(()), |_| Err(left_out("the log of a station", "lab")))
    }
}

/// Modules that stand for commands that are left out. They take whatever the commands take, a call for help too, and say so.
macro_rules! stand_in {
    ($($module:ident: $name:literal $feature:literal;)+) => {
        $(pub mod $module {
            #[doc = concat!("Not in this program: the feature `", $feature, "` brings it")]
            #[derive(clap::Args)]
            #[command(disable_help_flag = true)]
            pub struct Arguments {
                #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
                _words: Vec<std::ffi::OsString>,
            }

            pub fn run(_: impl std::borrow::Borrow<Arguments>) -> anyhow::Result<crate::exit::Exit> {
                Err(crate::left_out::left_out(concat!("`bench ", $name, "`"), $feature))
            }
        })+
    };
}
pub(crate) use stand_in;
