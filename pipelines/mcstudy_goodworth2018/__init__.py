"""The study of Goodworth & Peterka (2018): its published numbers, its solver and its lost table, attached to mcstudy."""
