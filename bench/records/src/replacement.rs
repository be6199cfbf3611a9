//! Files that are replaced as a whole.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
#[cfg(target_os = "linux")]
use rustix::fs::{Access, CWD, RenameFlags, access, renameat_with};

/// How safely a file is stored before work goes on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Durability {
    /// It survives a power failure, since a real measurement cannot be repeated.
    Synced,
    /// It survives the end of this process. This is enough for a run that its seed repeats.
    Written,
}

/// New content of a file, which is written beside it until it is complete. Without [`finish`](Self::finish) the old file stays
/// and nothing else is left.
///
/// What is no file, such as a device or a pipe, cannot be replaced; the content goes straight into it.
#[derive(Debug)]
pub struct Replacement {
    path: PathBuf,
    /// The file beside it; `None` for what cannot be replaced.
    new: Option<PathBuf>,
    file: File,
}

impl Replacement {
    /// Opens a file for the new content of `path`.
    ///
    /// # Errors
    ///
    /// It cannot be written.
    pub fn create(path: &Path) -> anyhow::Result<Self> {
        let open = || -> io::Result<Self> {
            let Some(path) = replaced(path)? else {
                let file = OpenOptions::new().write(true).open(path)?;
                return Ok(Self { path: path.to_owned(), new: None, file });
            };
            let mut name = path.file_name().unwrap_or_default().to_owned();
            name.push(".new");
            let new = path.with_file_name(name);
            Ok(Self { file: File::create(&new)?, new: Some(new), path })
        };
        open().with_context(|| cannot_write(path))
    }

    /// Puts the new content in place: a reader sees either the old or the new one, also if this process is killed or the disk
    /// is full, and with `Synced` also after a power failure.
    ///
    /// # Errors
    ///
    /// Writing failed. The old file is unchanged.
    pub fn finish(mut self, durability: Durability) -> anyhow::Result<()> {
        let Some(new) = &self.new else { return Ok(()) };
        match durability {
            Durability::Synced => self.file.sync_data().and_then(|()| fs::rename(new, &self.path)),
            Durability::Written => put_in_place(new, &self.path),
        }
        .with_context(|| cannot_write(&self.path))?;
        self.new = None;
        Ok(())
    }

    /// Returns the file for the new content.
    pub const fn file(&mut self) -> &mut File {
        &mut self.file
    }
}

impl Drop for Replacement {
    fn drop(&mut self) {
        // A partly written file would use the last bytes of a full disk.
        if let Some(new) = &self.new {
            let _ = fs::remove_file(new);
        }
    }
}

/// Replaces a file as a whole, see [`Replacement`].
///
/// # Errors
///
/// Writing failed. The old file is unchanged and nothing else is left.
pub fn replace(path: &Path, content: impl AsRef<[u8]>, durability: Durability) -> anyhow::Result<()> {
    let mut replacement = Replacement::create(path)?;
    replacement.file().write_all(content.as_ref()).with_context(|| cannot_write(path))?;
    replacement.finish(durability)
}

/// Returns the path of what is replaced where `path` is: a link stays, and what it leads to is replaced. `None` for what is no
/// file and cannot be.
fn replaced(path: &Path) -> io::Result<Option<PathBuf>> {
    match fs::metadata(path) {
        Ok(found) if found.is_file() || found.is_dir() => path.canonicalize().map(Some),
        Ok(_) => Ok(None),
        Err(_) => Ok(Some(path.to_owned())),
    }
}

/// Checks that a file can be replaced, or written to where it cannot be.
///
/// # Errors
///
/// It is a directory, or this user may not write it.
pub fn check_replaceable(path: &Path) -> anyhow::Result<()> {
    ensure!(!path.is_dir(), "{} is a directory; name a file", path.display());
    let Some(path) = replaced(path).with_context(|| cannot_write(path))? else {
        return may_write(path).with_context(|| cannot_write(path));
    };
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    check_writable(parent.unwrap_or(Path::new(".")))
}

/// Checks that files can be written to a directory.
///
/// # Errors
///
/// It is missing, or this user may not write to it.
pub fn check_writable(directory: &Path) -> anyhow::Result<()> {
    may_write_into(directory)
        .with_context(|| format!("cannot write to {}; choose another directory", directory.display()))
}

#[cfg(target_os = "linux")]
fn may_write(path: &Path) -> io::Result<()> {
    Ok(access(path, Access::WRITE_OK)?)
}

#[cfg(target_os = "linux")]
fn may_write_into(directory: &Path) -> io::Result<()> {
    Ok(access(directory, Access::WRITE_OK | Access::EXEC_OK)?)
}

/// Opens it, since the standard library does not know what a user may do.
#[cfg(not(target_os = "linux"))]
fn may_write(path: &Path) -> io::Result<()> {
    OpenOptions::new().write(true).open(path).map(drop)
}

#[cfg(not(target_os = "linux"))]
fn may_write_into(directory: &Path) -> io::Result<()> {
    match fs::metadata(directory)?.permissions().readonly() {
        true => Err(io::ErrorKind::PermissionDenied.into()),
        false => Ok(()),
    }
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

/// Gives `new` the name of the file that it replaces. If a file is renamed over another one, ext4 writes its data to
/// disk at once, as if it had to survive a power failure: more than a millisecond after each repetition, a seventh of
/// a virtual run. Exchanging two names is as atomic and costs nothing.
#[cfg(target_os = "linux")]
fn put_in_place(new: &Path, path: &Path) -> io::Result<()> {
    // An exchange would also accept a directory in place of a file.
    let replaces_file = fs::symlink_metadata(path).is_ok_and(|found| found.is_file());
    if replaces_file && renameat_with(CWD, new, CWD, path, RenameFlags::EXCHANGE).is_ok() {
        // This is the old content. If it stays, the next replacement overwrites it.
        let _ = fs::remove_file(new);
        return Ok(());
    }
    fs::rename(new, path)
}

#[cfg(not(target_os = "linux"))]
fn put_in_place(new: &Path, path: &Path) -> io::Result<()> {
    fs::rename(new, path)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::io::Read as _;
    use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
    use std::sync::atomic::{AtomicBool, Ordering};

    use rustix::fs::{FileType, Mode, OFlags, mknodat};

    #[test]
    fn a_file_is_replaced_as_a_whole_and_nothing_else_is_left() {
        for durability in [Durability::Written, Durability::Synced] {
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("results.json");
            for content in ["the first, which is longer", "the second"] {
                replace(&path, content, durability).unwrap();
                assert_eq!(fs::read_to_string(&path).unwrap(), content);
                assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
            }
        }
    }

    #[test]
    fn a_reader_of_a_file_that_is_being_replaced_sees_the_old_or_the_new_content() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("results.json");
        let contents = ["a".repeat(5_000), "b".repeat(4_000)];
        replace(&path, &contents[0], Durability::Written).unwrap();
        let is_done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let reader = scope.spawn(|| {
                while !is_done.load(Ordering::Relaxed) {
                    assert!(contents.contains(&fs::read_to_string(&path).unwrap()));
                }
            });
            for content in contents.iter().cycle().take(2_000) {
                replace(&path, content, Durability::Written).unwrap();
            }
            is_done.store(true, Ordering::Relaxed);
            reader.join().unwrap();
        });
    }

    #[test]
    fn a_directory_in_place_of_a_file_is_not_replaced() {
        for durability in [Durability::Written, Durability::Synced] {
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("results.json");
            fs::create_dir(&path).unwrap();
            replace(&path, "content", durability).unwrap_err();
            assert!(path.is_dir());
            assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
        }
    }

    #[test]
    fn a_replacement_that_is_not_finished_leaves_the_old_file_and_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("list");
        fs::write(&path, "the old list").unwrap();
        let mut replacement = Replacement::create(&path).unwrap();
        replacement.file().write_all(b"the first half").unwrap();
        drop(replacement);
        assert_eq!(fs::read_to_string(&path).unwrap(), "the old list");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_pipe_takes_the_content_and_stays_a_pipe() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pipe");
        mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let nonblocking = OFlags::NONBLOCK.bits().cast_signed();
        let mut reader = OpenOptions::new().read(true).custom_flags(nonblocking).open(&path).unwrap();
        replace(&path, "content", Durability::Synced).unwrap();
        let mut taken = String::new();
        reader.read_to_string(&mut taken).unwrap();
        assert_eq!(taken, "content");
        assert!(path.metadata().unwrap().file_type().is_fifo());
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_pipe_and_a_link_are_checked_where_they_are_written_to() {
        let directory = tempfile::tempdir().unwrap();
        let [pipe, link] = ["pipe", "link"].map(|name| directory.path().join(name));
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        check_replaceable(&pipe).unwrap();
        let other = tempfile::tempdir().unwrap();
        let file = other.path().join("file");
        fs::write(&file, "").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        check_replaceable(&link).unwrap();
        let refused = |path: &Path| check_replaceable(path).unwrap_err().to_string();
        assert!(refused(other.path()).ends_with("is a directory; name a file"));
        assert!(refused(&other.path().join("nowhere/file")).contains("nowhere; choose another directory"));
    }

    #[test]
    fn a_link_stays_and_what_it_leads_to_is_replaced() {
        let directory = tempfile::tempdir().unwrap();
        let [path, link] = ["file", "link"].map(|name| directory.path().join(name));
        fs::write(&path, "old").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        replace(&link, "new", Durability::Written).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert!(link.symlink_metadata().unwrap().is_symlink());
    }
}
