//! What a program says that was built without a part of it.

/// That something is not there, and how it comes.
pub fn left_out(what: &str, feature: &str) -> anyhow::Error {
    anyhow::anyhow!(
        "this program was built without {what}: build it without --no-default-features, or with --features {feature}"
    )
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
