//! `print!`, `println!` and `eprintln!` for a reader that may be gone.
//!
//! Who closes the other end of a pipe, as `head` does, wants no more; that is no failure of a run whose results are saved.

/// As [`print!`], and no panic where nobody reads any more.
#[macro_export]
macro_rules! out {
    ($($words:tt)*) => {{
        let _ = std::io::Write::write_fmt(&mut std::io::stdout(), format_args!($($words)*));
    }};
}

/// As [`println!`], and no panic where nobody reads any more.
#[macro_export]
macro_rules! outln {
    ($($words:tt)*) => { $crate::out!("{}\n", format_args!($($words)*)) };
}

/// As [`eprintln!`], and no panic where nobody reads any more.
#[macro_export]
macro_rules! errln {
    ($($words:tt)*) => {{
        let _ = std::io::Write::write_fmt(&mut std::io::stderr(), format_args!("{}\n", format_args!($($words)*)));
    }};
}
