"""A Ray cluster of two nodes with one core each on this machine: prints its address, ends with
standard input."""

import sys
import tempfile

from ray.cluster_utils import Cluster

with tempfile.TemporaryDirectory(prefix="nodes-", ignore_cleanup_errors=True) as folder:
    node = {"num_cpus": 1, "include_dashboard": False, "node_ip_address": "127.0.0.1"}
    cluster = Cluster(initialize_head=True, head_node_args={**node, "temp_dir": folder})
    try:
        cluster.add_node(**node)
        print(cluster.address, flush=True)
        sys.stdin.read()
    finally:
        cluster.shutdown()
