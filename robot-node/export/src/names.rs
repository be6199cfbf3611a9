//! Names in the files of an export: none is a word of the maker's language, none is too long, none stands for two things.
//!
//! Read from the text, so the names of the adapters count as well. Both languages ignore case.

use std::collections::BTreeMap;

use crate::application::Maker;
use crate::printed::ExportFile;

/// A name that a maker's controller would not take, or would take for something else.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum NameFault {
    /// A keyword, a type, a standard function or a variable of the controller.
    #[error("{file}: `{name}` is a word of {language}; rename it")]
    Word {
        /// The file.
        file: String,
        /// The name.
        name: String,
        /// The language.
        language: &'static str,
    },
    /// More characters than the language takes.
    #[error("{file}: `{name}` has {len} characters, {language} takes {most}; shorten it")]
    Long {
        /// The file.
        file: String,
        /// The name.
        name: String,
        /// Its length in characters.
        len: usize,
        /// Most characters of a name.
        most: usize,
        /// The language.
        language: &'static str,
    },
    /// Two declarations that the language takes for one.
    #[error("{file}: `{name}` is declared in {other} as `{first}`; {language} ignores case: rename one")]
    Twice {
        /// The file.
        file: String,
        /// The name.
        name: String,
        /// File of the first declaration.
        other: String,
        /// The first declaration.
        first: String,
        /// The language.
        language: &'static str,
    },
}

/// Words that no name may be: keywords, types, standard functions, and names that a new project has already.
const KRL_WORDS: &str = "ABS ACOS AND ANIN ANOUT ASC ATAN2 AXIS BAS BASE_DATA BASE_NAME BASISTECH BIN BOOL BRAKE BREAK B_AND B_EXOR B_NOT B_OR \
    CASE CAST_FROM CAST_TO CCLOSE CHANNEL CHAR CIRC CIRC_REL CLEAR_KRLMSG CONFIRM CONST CONST_KEY CONTINUE COPEN COS CREAD CWRITE C_DIS \
    C_ORI C_PTP C_SPL C_VEL DECL DEF DEFAULT DEFDAT DEFFCT DELAY DIGIN DISTANCE DO E3AXIS E3POS E6AXIS E6POS ELSE ENABLE END ENDDAT \
    ENDFCT ENDFOR ENDIF ENDLOOP ENDSPLINE ENDSWITCH ENDWHILE ENUM EOF EXIT EXT EXTFCT EXTFCTP EXTP FALSE FDAT FDAT_ACT FIN FOR FORWARD \
    FRAME GET_SIG_INF GLOBAL GOTO HALT IF IMPORT INI INT INTERRUPT INVERSE INV_POS IR_STOPM IS KEY_REAL LAST_BASIS LAST_TP_PARAMS LDAT \
    LDAT_ACT LIN LIN_REL LOAD_DATA LOOP MACHINE_DATA MAXIMIZE MBX_REC MINIMIZE NOT OFF ON ONPATH OPTION OR OUT P00 PATH PDAT PDAT_ACT \
    POS PRIO PROC PTP PTP_REL PUBLIC PULSE REAL REF REPEAT RESUME RETURN SCIRC SEC SET_KRLMSG SIGNAL SIN SLIN SPL SPLINE SPTP SQRT SREAD \
    SRT STRADD STRCLEAR STRCOMP STRCOPY STRDECLLEN STRFIND STRLEN STRUC STRUCT SWITCH SWRITE TAN THEN TIMER TIME_BLOCK TO TOOL_DATA \
    TOOL_NAME TRIGGER TRUE TYPE UNTIL USERSPOT USER_GRP VAR VARSTATE WAIT WHEN WHILE WITH XHOME XOR";

/// The same for RAPID.
const RAPID_WORDS: &str = "ABS ACCSET ACOS ACTUNIT ADD ALIAS ALIASIO AND ASIN ATAN ATAN2 BACKWARD BITAND BITANDDNUM BITOR BITXOR BITXORDNUM \
    BOOKERRNO BOOL BREAK BYTE BYTETOSTR CALCJOINTT CALCROBT CALLBYVAR CASE CDATE CJOINTT CLEAR CLEARPATH CLKREAD CLKRESET CLKSTART \
    CLKSTOP CLOCK CLOSE CONFDATA CONFJ CONFL CONNECT CONST COS CPOS CROBT CTIME CTOOL CWOBJ DEACTUNIT DECR DEFAULT DIM DIV DNUM \
    DNUMTONUM DNUMTOSTR DO DOUTPUT ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE ENDPROC ENDRECORD ENDTEST ENDTRAP ENDWHILE ERRLOG ERRNO \
    ERRNUM ERROR ERRWRITE EULERZYX EXIT EXITCYCLE EXTJOINT FALSE FINE FOR FROM FUNC GINPUT GINPUTDNUM GOTO GOUTPUT IDELETE IDISABLE \
    IENABLE IF INCR INOUT INTNUM INVERTDO INVERSE IODEV IPERS ISIGNALDI ISIGNALDO ISLEEP ITIMER IWATCH JOINTTARGET LABEL LOAD \
    LOADDATA LOADID LOCAL MAIN MAXROBSPEED MOD MODULE MOTSETDATA MOVEABSJ MOVEC MOVEJ MOVEL NOSTEPIN NOT NOVIEW NUM NUMTODNUM OFFS \
    OPEN OR ORIENT ORIENTZYX ORROBTARGET PACKRAWBYTES PATHACCLIM PERS POS POSE POSEINV POSEMULT PRESENT PROC PULSEDO RAISE RAWBYTES \
    READBIN READNUM READONLY RECORD RELTOOL RESET RESTOPATH RETRY RETURN ROBJOINT ROBTARGET ROUND SEARCHL SET SETAO SETDO SETGO \
    SHAREDOBJECT SIGNALAI SIGNALAO SIGNALDI SIGNALDO SIGNALGI SIGNALGO SIN SINGAREA SOCKETDEV SPEEDDATA SPEEDREFRESH SQRT STARTMOVE \
    STEP STOP STOPMOVE STOREPATH STRING STRLEN STRTOBYTE SYMNUM SYSMODULE TAN TASK TASKNAME TASKS TESTDI TEST TEXTGET THEN TO TOOL0 \
    TOOLDATA TPERASE TPREADFK TPWRITE TRAP TRIGGC TRIGGDATA TRIGGINT TRIGGIO TRIGGJ TRIGGL TRIGGIOS TRUE TRUNC TRYNEXT UNDO UNLOAD \
    UNPACKRAWBYTES VAR VELSET VIEWONLY WAITDI WAITTIME WAITUNTIL WHILE WITH WOBJ0 WOBJDATA WRITE XOR ZONEDATA";

/// Most characters of a name: KRL, as `$config.dat` takes them; RAPID and its I/O configuration.
const fn most_characters(maker: Maker) -> usize {
    match maker {
        Maker::Kuka => 24,
        Maker::Abb => 32,
    }
}

/// A declared name: the routine that it belongs to, in upper case, and empty for one that all see.
#[derive(Clone, PartialEq, Eq, Debug)]
struct DeclaredName<'a> {
    scope: String,
    name: &'a str,
}

/// Checks the names in the files of an export.
///
/// # Errors
/// The first name that collides with a word of the language or with another name, or is too long.
pub fn check_names(files: &[ExportFile], maker: Maker) -> Result<(), NameFault> {
    let (language, most) = (maker.language(), most_characters(maker));
    let words = match maker {
        Maker::Kuka => KRL_WORDS,
        Maker::Abb => RAPID_WORDS,
    };
    let declared: Vec<(&ExportFile, Vec<DeclaredName<'_>>)> =
        files.iter().map(|file| (file, declared_in(file, maker))).collect();
    for (file, names) in &declared {
        for DeclaredName { name, .. } in names {
            let (file, owned) = (file.path.clone(), (*name).to_owned());
            if words.split_ascii_whitespace().any(|word| word.eq_ignore_ascii_case(name)) {
                return Err(NameFault::Word { file, name: owned, language });
            }
            if name.len() > most {
                return Err(NameFault::Long { file, name: owned, len: name.len(), most, language });
            }
        }
    }
    for task in tasks(maker) {
        let mut seen = BTreeMap::new();
        for (file, names) in declared.iter().filter(|(file, _)| task.is_none_or(|task| task != file.path)) {
            for DeclaredName { scope, name } in names {
                let key = (scope, name.to_ascii_uppercase());
                if let Some((other, first)) = seen.insert(key, (&file.path, *name)) {
                    return Err(NameFault::Twice {
                        file: file.path.clone(),
                        name: (*name).to_owned(),
                        other: other.clone(),
                        first: first.to_owned(),
                        language,
                    });
                }
            }
        }
    }
    Ok(())
}

/// Returns the tasks, each by the file that it does not load: modules of different tasks may declare the same names.
const fn tasks(maker: Maker) -> &'static [Option<&'static str>] {
    match maker {
        Maker::Kuka => &[None],
        Maker::Abb => &[Some("SB_Cyclic.mod"), Some("SB_Motion.mod")],
    }
}

fn declared_in(file: &ExportFile, maker: Maker) -> Vec<DeclaredName<'_>> {
    let mut names = Vec::new();
    let mut scope = String::new();
    for line in file.text.lines() {
        match maker {
            Maker::Abb if file.path.ends_with(".cfg") => {
                let quoted = line.split_once("-Name \"").and_then(|(_, rest)| rest.split_once('"'));
                names.extend(quoted.map(|(name, _)| DeclaredName { scope: String::new(), name }));
            }
            Maker::Abb => rapid_line(line, &mut scope, &mut names),
            Maker::Kuka => krl_line(line, &mut scope, &mut names),
        }
    }
    names
}

/// Returns the words of a line up to its comment.
fn line_words(line: &str, comment: char) -> Vec<&str> {
    let line = line.split(comment).next().unwrap_or_default();
    let is_of_word =
        |character: char| character.is_ascii_alphanumeric() || matches!(character, '_' | '$' | '.' | '#');
    line.split(|character| !is_of_word(character)).filter(|word| !word.is_empty()).collect()
}

fn krl_line<'a>(line: &'a str, scope: &mut String, names: &mut Vec<DeclaredName<'a>>) {
    let words: Vec<_> = line_words(line, ';').into_iter().filter(|word| *word != "GLOBAL").collect();
    let (mut of_file, mut of_routine) = (None, None);
    match words.as_slice() {
        ["DEF", name, ..] | ["DEFFCT", _, name, ..] => {
            of_file = Some(*name);
            *scope = name.to_ascii_uppercase();
        }
        ["DEFDAT", name, ..] | ["SIGNAL", name, ..] => of_file = Some(*name),
        ["END" | "ENDFCT"] => scope.clear(),
        ["DECL", "CONST", _, name, ..] | ["DECL", _, name, ..] => of_routine = Some(*name),
        _ => {}
    }
    names.extend(of_file.map(|name| DeclaredName { scope: String::new(), name }));
    names.extend(of_routine.map(|name| DeclaredName { scope: scope.clone(), name }));
}

fn rapid_line<'a>(line: &'a str, scope: &mut String, names: &mut Vec<DeclaredName<'a>>) {
    let words = line_words(line, '!');
    let words = words.strip_prefix(&["LOCAL"]).unwrap_or(&words);
    let (mut of_module, mut of_routine): (Option<&str>, &[&str]) = (None, &[]);
    let parameters;
    match words {
        ["MODULE", name, ..] => of_module = Some(name),
        ["PROC", name, typed @ ..] | ["FUNC", _, name, typed @ ..] | ["TRAP", name, typed @ ..] => {
            of_module = Some(name);
            *scope = name.to_ascii_uppercase();
            // A type and a name each.
            parameters = typed.iter().skip(1).step_by(2).copied().collect::<Vec<_>>();
            of_routine = &parameters;
        }
        ["ENDPROC" | "ENDFUNC" | "ENDTRAP"] => scope.clear(),
        ["VAR" | "PERS" | "CONST", _, name, ..] => of_routine = std::slice::from_ref(name),
        // Several loops of a routine may have the same one.
        ["FOR", name, ..] if !names.iter().any(|one| one.scope == *scope && one.name == *name) => {
            of_routine = std::slice::from_ref(name);
        }
        _ => {}
    }
    names.extend(of_module.map(|name| DeclaredName { scope: String::new(), name }));
    names.extend(of_routine.iter().map(|name| DeclaredName { scope: scope.clone(), name }));
}
