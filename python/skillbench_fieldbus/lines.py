"""Programs that say one JSON value a line, and take instructions one a line."""

import json
import signal
import socket
import subprocess
import threading

#: Seconds without the message that is waited for.
PATIENCE = 30.0


class Refused(Exception):
    """An instruction was refused; the text has the reason."""


class Ended(Exception):
    """The program ended, or closed the connection, before the message that was waited for."""


class Silence(Exception):
    """The message that was waited for did not come in time."""


class Lines:
    """Messages of a program in the order in which they came.

    A thread reads them; `wait_for` takes them one after another.
    """

    def __init__(self, received, send):
        self.messages = []
        self._send = send
        self._taken = 0
        self._is_over = False
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read, args=(received,), daemon=True)
        self._reader.start()

    def _read(self, received):
        try:
            for line in received:
                try:
                    message = json.loads(line)
                except ValueError:
                    message = {"text": line.rstrip("\n")}
                with self._changed:
                    self.messages.append(message)
                    self._notice(message)
                    self._changed.notify_all()
        except (OSError, ValueError):
            pass
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def _notice(self, message):
        """Keeps what a kind of program wants to know of each message at once."""

    def send(self, instruction):
        """Sends a line: a text as it is, any other value as JSON."""
        text = instruction if isinstance(instruction, str) else json.dumps(instruction)
        try:
            self._send(text + "\n")
        except (OSError, ValueError) as error:
            raise Ended(f"cannot send {text}: {error}; {self._said()}") from error

    def wait_for(self, accept, what, patience=None):
        """Returns the next message that is accepted, and takes those before it.

        Raises `Refused` at an instruction that was refused, `Ended` where no more messages come, `Silence` after `patience`
        seconds (30 without it). `what` names the message in these errors.
        """
        patience = PATIENCE if patience is None else patience
        with self._changed:
            while True:
                while self._taken < len(self.messages):
                    message = self.messages[self._taken]
                    self._taken += 1
                    if accept(message):
                        return message
                    reason = self._refusal(message)
                    if reason is not None:
                        raise Refused(reason)
                if self._is_over:
                    raise Ended(f"ended before {what}; {self._said()}")
                if not self._changed.wait(patience):
                    raise Silence(f"no {what} within {patience:g} s; {self._said()}")

    @staticmethod
    def _refusal(message):
        return message.get("refused") if isinstance(message, dict) else None

    def _said(self):
        last = [json.dumps(message)[:300] for message in self.messages[-5:]]
        return "last messages: " + ("; ".join(last) if last else "none")


class ProgramLines(Lines):
    """A program that was started for this, by its standard input and output."""

    def __init__(self, command):
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8", bufsize=1
        )
        self.errors = []
        self._drain = threading.Thread(target=lambda: self.errors.extend(self.process.stderr), daemon=True)
        self._drain.start()
        super().__init__(self.process.stdout, self._write)

    def _write(self, text):
        self.process.stdin.write(text)
        self.process.stdin.flush()

    def _said(self):
        if self._is_over:
            self._drain.join(1.0)
        return super()._said() + "".join(f"\n  {line.rstrip()}" for line in self.errors[-5:])

    def _end(self):
        """Asks the program to end."""
        self.process.send_signal(signal.SIGINT)

    def close(self):
        """Ends the program, and returns its exit code. It closes its connections in order."""
        if self.process.poll() is None:
            self._end()
            try:
                self.process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self.process.kill()
        code = self.process.wait()
        self._reader.join(1.0)
        self._drain.join(1.0)
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            try:
                stream.close()
            except OSError:
                pass
        return code

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class SocketLines(Lines):
    """A program that is reached over TCP."""

    def __init__(self, host, port):
        self._socket = socket.create_connection((host, port), timeout=PATIENCE)
        self._socket.settimeout(None)
        stream = self._socket.makefile("r", encoding="utf-8", newline="\n")
        super().__init__(stream, lambda text: self._socket.sendall(text.encode()))

    def close(self):
        """Closes the connection. The program goes on."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._socket.close()
        self._reader.join(1.0)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
