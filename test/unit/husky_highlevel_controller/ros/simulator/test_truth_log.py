"""Log of true poses: its lines stay whole."""

import json
import threading
import time

from husky_highlevel_controller.ros.simulator.truth_log import TruthLog


def test_lines_of_the_truth_are_whole_when_threads_write_at_once(tmp_path, monkeypatch):
    class Socket:
        """Sends byte by byte, as a full buffer does."""

        sent = bytearray()

        def sendall(self, content):
            for each in content:
                self.sent.append(each)
                time.sleep(0)

    log = TruthLog()
    log._socket = Socket()
    threads = [threading.Thread(target=log.write_line, args=("changed", "x" * 2000)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [json.loads(line) for line in bytes(Socket.sent).splitlines()] == [{"changed": "x" * 2000}] * 8
