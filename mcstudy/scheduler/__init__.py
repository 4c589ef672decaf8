"""Starting workers, handing out tasks to them, showing progress and stopping."""
