//! `bench study submit`: the shards of a study as jobs of an engine that exists. The grain is a shard, since each of these engines
//! takes longer to start a job than a repetition takes.

use std::fmt::Write as _;
use std::path::{Path, PathBuf, absolute};
use std::process::Command;

use anyhow::{Context as _, anyhow};
use clap::ValueEnum;

use records::exit::{Exit, Failure};
use records::run_directory::{Durability, replace};
use report::{errln, in_shell, out, outln};

use super::SubmitOptions;
use super::folder::of_host;
use super::plan::StudyPlan;

/// Digits of a study's digest in the name of a job.
const NAME_DIGITS: usize = 12;

/// Who runs the shards.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Engine {
    /// This machine, one shard after the other on all cores.
    Local,
    /// Slurm: a job array.
    Slurm,
    /// HyperQueue, by its Python package.
    Hq,
    /// Kubernetes: an Indexed Job, printed only.
    Kubernetes,
}

/// Hands a study to an engine, or prints what would be handed over.
///
/// # Errors
///
/// The study is invalid, the engine is not installed or refuses it, or a file cannot be written.
pub(super) fn run(options: &SubmitOptions) -> Result<Exit, Failure> {
    let usage = |error| Failure::new(Exit::Usage, error);
    // A mistake in the study is found here, and not by each shard.
    let plan = StudyPlan::read(&options.file, String::new())?;
    let bench = std::env::current_exe().context("cannot find this program's file")?;
    let shards = Shards {
        bench,
        file: absolute(&options.file).context("cannot find the study's file")?,
        out: absolute(&options.out).context("cannot find the directory of --out")?,
        count: options.shards,
        study: plan.identity.chars().take(NAME_DIGITS).collect(),
    };
    match options.engine {
        Engine::Local if options.print => {
            (0..shards.count).for_each(|index| outln!("{}", shards.command(&index.to_string(), None)));
            Ok(Exit::Pass)
        }
        Engine::Local => shards.run_here(),
        Engine::Slurm => shards.submit("submit.sbatch", &shards.slurm(), options.print, |path| {
            let mut sbatch = Command::new("sbatch");
            sbatch.arg(path);
            (sbatch, "Slurm's `sbatch`: Debian has it in slurm-wlm")
        }),
        Engine::Hq => {
            let text = shards.hyperqueue(options.server_dir.as_deref()).map_err(usage)?;
            shards.submit("submit.py", &text, options.print, |path| {
                let mut python = Command::new(&options.python);
                python.arg(path);
                (python, "a Python with the package `hyperqueue`: name it by --python")
            })
        }
        Engine::Kubernetes => {
            if !options.print {
                return Err(usage(anyhow!(
                    "--engine kubernetes: only printed; add --print and give it to `kubectl apply -f -`"
                )));
            }
            let (Some(image), Some(volume)) = (&options.image, &options.volume) else {
                return Err(usage(anyhow!("--engine kubernetes: needs --image and --volume")));
            };
            out!("{}", shards.kubernetes(image, volume).map_err(usage)?);
            Ok(Exit::Pass)
        }
    }
}

/// The shards of a study, with absolute paths: an engine may start them anywhere.
struct Shards {
    bench: PathBuf,
    file: PathBuf,
    out: PathBuf,
    count: u32,
    /// Begin of the study's digest, for the names of jobs.
    study: String,
}

impl Shards {
    /// Returns the command of a shard for a shell, `index` being a number or a variable.
    fn command(&self, index: &str, threads: Option<&str>) -> String {
        let Self { bench, file, out, count, .. } = self;
        let [bench, file, out] = [bench, file, out].map(|path| in_shell(path.display()));
        let threads = threads.map_or_else(String::new, |threads| format!(" --threads {threads}"));
        format!("{bench} study run {file} --out {out}/shard-{index} --shard {index}/{count}{threads} --quiet")
    }

    /// Runs all shards on this machine.
    fn run_here(&self) -> Result<Exit, Failure> {
        let mut worst = Exit::Pass;
        for index in 0..self.count {
            let ran = Command::new(&self.bench)
                .args(["study", "run"])
                .arg(&self.file)
                .arg("--out")
                .arg(self.out.join(format!("shard-{index}")))
                .args(["--shard", &format!("{index}/{}", self.count), "--quiet"])
                .status()
                .with_context(|| format!("cannot run {}", self.bench.display()))
                .map_err(of_host)?;
            match ran.code() {
                Some(0) => {}
                Some(4) => worst = Exit::RunFailed,
                Some(130) => return Ok(Exit::Interrupted),
                code => {
                    let ended =
                        code.map_or_else(|| "by a signal".to_owned(), |code| format!("with code {code}"));
                    return Err(of_host(anyhow!(
                        "shard {index}/{}: ended {ended}; the same command goes on where it ended",
                        self.count
                    )));
                }
            }
        }
        outln!("bench study merge {} --out DIR", in_shell(self.out.display()));
        Ok(worst)
    }

    /// Writes a file for an engine and runs the program that takes it, or prints it.
    fn submit<'a>(
        &self,
        name: &str,
        text: &str,
        only_print: bool,
        engine: impl Fn(&Path) -> (Command, &'a str),
    ) -> Result<Exit, Failure> {
        if only_print {
            out!("{text}");
            return Ok(Exit::Pass);
        }
        std::fs::create_dir_all(&self.out)
            .with_context(|| format!("cannot make the directory {}", self.out.display()))
            .map_err(of_host)?;
        let path = self.out.join(name);
        replace(&path, text, Durability::Written).map_err(of_host)?;
        let (mut command, what) = engine(&path);
        let ran = command.status().map_err(|error| of_host(anyhow!("cannot start {what} ({error})")))?;
        if ran.success() {
            outln!("bench study status {}", in_shell(self.out.display()));
            return Ok(Exit::Pass);
        }
        errln!("{} is what was handed over", path.display());
        // Where all rows are there, the jobs failed and not the engine.
        if super::status::is_complete(&self.out) {
            return Ok(Exit::RunFailed);
        }
        Err(of_host(anyhow!(
            "the engine refused or lost a shard, as said above; it needs {what}, and a server that it reaches"
        )))
    }

    /// Returns a batch script with a job array.
    fn slurm(&self) -> String {
        let last = self.count.saturating_sub(1);
        let logs = self.out.join("slurm-%a.log");
        let command = self.command("\"$SLURM_ARRAY_TASK_ID\"", Some("\"${SLURM_CPUS_PER_TASK:-1}\""));
        format!(
            "#!/bin/sh\n#SBATCH --job-name=skillbench\n#SBATCH --array=0-{last}\n#SBATCH --ntasks=1\n\
             #SBATCH --cpus-per-task=1\n#SBATCH --requeue\n#SBATCH --output={}\n\
             # A shard that is started again goes on where it ended.\nexec {command}\n",
            logs.display()
        )
    }

    /// Returns a Python program for the package `hyperqueue`.
    fn hyperqueue(&self, server: Option<&Path>) -> anyhow::Result<String> {
        let Self { bench, file, out, count, .. } = self;
        // A text of JSON is one of Python, too.
        let text = |path: &Path| serde_json::to_string(&path.display().to_string());
        let (bench, file, out) = (text(bench)?, text(file)?, text(out)?);
        let (opened, closed) = match server {
            Some(directory) => {
                (format!("client = Client({})\n", text(&absolute(directory)?)?), String::new())
            }
            None => (
                "cluster = LocalCluster()\nfor _ in range(os.cpu_count() or 1):\n    \
                 cluster.start_worker(WorkerConfig(cores=1))\nclient = cluster.client()\n"
                    .to_owned(),
                "cluster.stop()\n".to_owned(),
            ),
        };
        Ok(format!(
            "# The shards of a study for HyperQueue; a shard whose worker is lost starts again and goes on.\n\
             import os\nimport sys\n\n\
             try:\n    from hyperqueue import Client, Job, LocalCluster\n    \
             from hyperqueue.client import FailedJobsException\n    from hyperqueue.cluster import WorkerConfig\n\
             except ImportError:\n    sys.exit(\"this Python has no package `hyperqueue`\")\n\n\
             BENCH, FILE, OUT, SHARDS = {bench}, {file}, {out}, {count}\n\n\
             {opened}job = Job()\nfor index in range(SHARDS):\n    job.program(\n        \
             [BENCH, \"study\", \"run\", FILE, \"--out\", f\"{{OUT}}/shard-{{index}}\", \"--shard\", f\"{{index}}/{{SHARDS}}\",\n         \
             \"--threads\", \"1\", \"--quiet\"],\n        \
             stdout=f\"{{OUT}}/hq-{{index}}.out\", stderr=f\"{{OUT}}/hq-{{index}}.err\")\n\
             status = 0\ntry:\n    client.wait_for_jobs([client.submit(job)])\n\
             except FailedJobsException as error:\n    print(error, file=sys.stderr)\n    status = 5\n{closed}sys.exit(status)\n"
        ))
    }

    /// Returns an Indexed Job.
    fn kubernetes(&self, image: &str, volume: &str) -> anyhow::Result<String> {
        let Self { file, out, count, study, .. } = self;
        if !file.starts_with(out) {
            anyhow::bail!(
                "{}: the pods see only {}; put the study, its setup and its application there",
                file.display(),
                out.display()
            );
        }
        let [file, directory] = [file, out].map(|path| in_shell(path.display()));
        let script = format!(
            "exec bench study run {file} --out {directory}/shard-$JOB_COMPLETION_INDEX --shard \
             $JOB_COMPLETION_INDEX/{count} --threads 1 --quiet"
        );
        let [image, volume, mount, script] =
            [image, volume, &out.display().to_string(), &script].map(serde_json::to_string);
        let (image, volume, mount, script) = (image?, volume?, mount?, script?);
        let mut text = format!("apiVersion: batch/v1\nkind: Job\nmetadata:\n  name: skillbench-{study}\n");
        // A pod that is lost starts again and goes on where it ended; one whose jobs failed (code 4) has all its rows.
        write!(
            text,
            "spec:\n  completionMode: Indexed\n  completions: {count}\n  parallelism: {count}\n  backoffLimitPerIndex: 3\n  \
             podFailurePolicy:\n    rules:\n      - action: FailIndex\n        onExitCodes:\n          containerName: shard\n          \
             operator: In\n          values: [4]\n  template:\n    spec:\n      restartPolicy: Never\n      containers:\n        - name: shard\n          image: {image}\n          \
             command: [\"/bin/sh\", \"-c\", {script}]\n          resources:\n            requests:\n              cpu: \"1\"\n          \
             volumeMounts:\n            - name: study\n              mountPath: {mount}\n      volumes:\n        - name: study\n          \
             persistentVolumeClaim:\n            claimName: {volume}\n"
        )?;
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shards() -> Shards {
        let [bench, file, out] =
            ["/opt/bench", "/data/my study/study.toml", "/data/my study"].map(PathBuf::from);
        Shards { bench, file, out, count: 3, study: "0123456789ab".to_owned() }
    }

    #[test]
    fn a_job_array_of_slurm_has_a_task_for_each_shard() {
        insta::assert_snapshot!(shards().slurm(), @r#"
#!/bin/sh
#SBATCH --job-name=skillbench
#SBATCH --array=0-2
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=1
#SBATCH --requeue
#SBATCH --output=/data/my study/slurm-%a.log
# A shard that is started again goes on where it ended.
exec /opt/bench study run '/data/my study/study.toml' --out '/data/my study'/shard-"$SLURM_ARRAY_TASK_ID" --shard "$SLURM_ARRAY_TASK_ID"/3 --threads "${SLURM_CPUS_PER_TASK:-1}" --quiet
"#);
    }

    #[test]
    fn hyperqueue_gets_a_program_of_python() {
        insta::assert_snapshot!(shards().hyperqueue(None).unwrap(), @r#"
# The shards of a study for HyperQueue; a shard whose worker is lost starts again and goes on.
import os
import sys

try:
    from hyperqueue import Client, Job, LocalCluster
    from hyperqueue.client import FailedJobsException
    from hyperqueue.cluster import WorkerConfig
except ImportError:
    sys.exit("this Python has no package `hyperqueue`")

BENCH, FILE, OUT, SHARDS = "/opt/bench", "/data/my study/study.toml", "/data/my study", 3

cluster = LocalCluster()
for _ in range(os.cpu_count() or 1):
    cluster.start_worker(WorkerConfig(cores=1))
client = cluster.client()
job = Job()
for index in range(SHARDS):
    job.program(
        [BENCH, "study", "run", FILE, "--out", f"{OUT}/shard-{index}", "--shard", f"{index}/{SHARDS}",
         "--threads", "1", "--quiet"],
        stdout=f"{OUT}/hq-{index}.out", stderr=f"{OUT}/hq-{index}.err")
status = 0
try:
    client.wait_for_jobs([client.submit(job)])
except FailedJobsException as error:
    print(error, file=sys.stderr)
    status = 5
cluster.stop()
sys.exit(status)
"#);
        assert!(
            shards()
                .hyperqueue(Some(Path::new("/srv/hq")))
                .unwrap()
                .contains("client = Client(\"/srv/hq\")\n")
        );
    }

    #[test]
    fn kubernetes_gets_an_indexed_job_and_refuses_a_study_that_its_pods_do_not_see() {
        insta::assert_snapshot!(shards().kubernetes("skillbench:1", "cell").unwrap(), @r#"
apiVersion: batch/v1
kind: Job
metadata:
  name: skillbench-0123456789ab
spec:
  completionMode: Indexed
  completions: 3
  parallelism: 3
  backoffLimitPerIndex: 3
  podFailurePolicy:
    rules:
      - action: FailIndex
        onExitCodes:
          containerName: shard
          operator: In
          values: [4]
  template:
    spec:
      restartPolicy: Never
      containers:
        - name: shard
          image: "skillbench:1"
          command: ["/bin/sh", "-c", "exec bench study run '/data/my study/study.toml' --out '/data/my study'/shard-$JOB_COMPLETION_INDEX --shard $JOB_COMPLETION_INDEX/3 --threads 1 --quiet"]
          resources:
            requests:
              cpu: "1"
          volumeMounts:
            - name: study
              mountPath: "/data/my study"
      volumes:
        - name: study
          persistentVolumeClaim:
            claimName: "cell"
"#);
        let hidden = Shards { file: "/home/me/study.toml".into(), ..shards() };
        let refused = hidden.kubernetes("skillbench:1", "cell").unwrap_err().to_string();
        assert!(refused.contains("the pods see only"), "{refused}");
    }
}
