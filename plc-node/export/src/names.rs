//! Names that the code declares: none is a word of a compiler, and no two differ only in case.

use std::collections::HashMap;

use crate::Refused;
use crate::parts::{CodePart, Parts};

/// Standard functions and function blocks of IEC 61131-3, which every compiler has, and words of the standard's third edition that
/// older compilers take as names.
const STANDARD: &str = "ABS ACOS ADD ADD_TIME ASIN ATAN ATAN2 CHAR CLASS CONCAT COS CTD CTU CTUD DELETE DIV DT DATE EQ EXP EXPT FIND F_TRIG GE GT \
    INSERT INTERFACE LE LEFT LEN LIMIT LINT LN LOG LREAL LT LWORD MAX METHOD MID MIN MOD MOVE MUL MUX NAMESPACE NE NOT NULL OVERRIDE REF \
    REF_TO REPLACE RIGHT ROL ROR RS RTC R_TRIG SEL SEMA SHL SHR SIN SQRT SR STRING SUB TAN THIS TIME TOD TOF TON TP TRUNC ULINT USING \
    WSTRING XOR";

/// Macros of the headers of C. Compilers that make C or C++ of the code write its names in capitals, and include such headers.
const C_MACROS: &str = "BIG_ENDIAN BUFSIZ BYTE_ORDER CHAR_BIT CLOCKS_PER_SEC DOMAIN EAGAIN EBUSY EDOM EILSEQ EINTR EINVAL EIO ENOMEM EOF EPERM \
    ERANGE ERRNO EXIT_FAILURE EXIT_SUCCESS FD_SET FD_ZERO HUGE HUGE_VAL INFINITY INT_MAX INT_MIN LITTLE_ENDIAN LONG_MAX LONG_MIN \
    L_TMPNAM MAXFLOAT M_E M_PI NAN NDEBUG NSIG OFFSETOF OVERFLOW PATH_MAX PLOSS RAND_MAX SEEK_CUR SEEK_END SEEK_SET SING SIG_DFL SIG_ERR \
    SIG_IGN STDERR STDIN STDOUT TLOSS TMP_MAX UINT_MAX UNDERFLOW VA_ARG VA_END VA_START";

/// Splits a maker's code and checks its names.
///
/// # Errors
/// It is not in the form of the templates, or has a name that the maker's compiler would not take.
pub(crate) fn checked_parts<'a>(
    text: &'a str,
    maker: &'static str,
    words: &[&str],
) -> Result<Parts<'a>, Refused> {
    let parts = Parts::split(text, maker)?;
    check(&parts, maker, words)?;
    Ok(parts)
}

/// Checks the names of a maker's code.
///
/// # Errors
/// The first name that is a word, or that stands for two things.
fn check(parts: &Parts<'_>, maker: &'static str, words: &[&str]) -> Result<(), Refused> {
    let is_word = |name: &str| {
        words
            .iter()
            .copied()
            .chain(STANDARD.split_ascii_whitespace())
            .chain(C_MACROS.split_ascii_whitespace())
            .any(|word| word.eq_ignore_ascii_case(name))
    };
    let mut of_all = HashMap::new();
    for part in &parts.parts {
        let (name, members) = part.declared_names();
        let mut of_part = HashMap::new();
        for (seen, name) in
            std::iter::once((true, name)).chain(members.into_iter().map(|member| (false, member)))
        {
            if is_word(name) {
                return Err(Refused::Word { name: name.into(), maker });
            }
            let seen = if seen { &mut of_all } else { &mut of_part };
            if let Some(other) = seen.insert(name.to_ascii_uppercase(), name) {
                return Err(Refused::SameName { name: name.into(), other: other.into(), maker });
            }
        }
    }
    Ok(())
}

/// Checks that blocks, functions and types have names of at most so many characters.
///
/// # Errors
/// The first longer one.
pub(crate) fn check_length(parts: &Parts<'_>, maker: &'static str, most: usize) -> Result<(), Refused> {
    // An array's type is not declared: its name is replaced where it stands.
    let mut declared = parts
        .parts
        .iter()
        .filter(|part| !matches!(part, CodePart::Type { name, .. } if parts.is_array(name)))
        .map(|part| part.declared_names().0);
    match declared.find(|name| name.len() > most) {
        Some(name) => Err(Refused::LongName { name: name.into(), most, maker }),
        None => Ok(()),
    }
}
