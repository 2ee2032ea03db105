"""End of a server of rosgraph, such as a master, that a test has started."""

import socket
import threading


def end(node):
    """End a server with its thread; rosgraph's own shutdown lets the thread spin on the closed socket."""
    node.is_shutdown = True
    ending = threading.Thread(target=node.server.shutdown)
    ending.start()
    socket.create_connection(node.server.server_address).close()  # wakes the thread at once
    ending.join()
    node.shutdown("the test is over")
