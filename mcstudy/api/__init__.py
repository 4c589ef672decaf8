"""What `import mcstudy` offers besides the classes and functions that it only passes on."""
