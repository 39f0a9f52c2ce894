import queue
import threading

from example_interfaces.srv import AddTwoInts

from taskrpc import sync

results = queue.Queue()


def work(client, first):
    for number in range(3):
        response = client.call(AddTwoInts.Request(a=first, b=number), timeout=20.0)
        results.put(response.sum)


with sync.Node("students") as node:
    client = node.create_client(AddTwoInts, "move")
    client.wait_for_service()
    threads = [threading.Thread(target=work, args=(client, first)) for first in (0, 10)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print("results:", sorted(results.get() for _ in range(6)))
